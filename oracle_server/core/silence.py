"""Properties of what comes often enough that can't see that nothing comes: what else they read is gone by then."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.lacking import lacking
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.kinds import RESERVED
from oracle_server.core.lacks import quoted
from oracle_server.core.spec import Property, Spec
from oracle_server.core.withholding import lasting, present, without_signals


def unseen_silence(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of properties over an age, or of patterns of what comes often enough, that no deadline violates."""
    for i, prop in enumerate(spec.properties):
        if prop.time != "seconds" or prop.numeric or prop.external or looks_ahead(prop.formula):
            continue
        names = frozenset(spec.derived_of(prop))
        reads = [each for each in spec.derive if each.name in names]
        measured = {measure.name for measure in prop.measures if measure.op == "rate"}
        awaits = any(each.op == "age" or each.name in measured for each in reads)
        gone = _gone(spec, prop, reads) if awaits else set()
        if gone and (prop.measures or not gone & RESERVED):
            message = f"formula of '{prop.id}': no deadline violates it, so that silence is not told: {_mend(gone)}"
            yield SpecProblem(("properties", i, "formula"), message, severity="warning", kind="vacuous")


def _mend(gone: set[str]) -> str:
    if gone & RESERVED:
        return "its scope is one message, and over at once; write what opens and closes it, as in `after E until E`"
    it, keeps = ("it", "it keeps its value") if len(gone) == 1 else ("them", "they keep their values")
    verb, whose = ("is", "its stream") if len(gone) == 1 else ("are", "their streams")
    return (
        f"{quoted(sorted(gone))} {verb} not there while no message comes; name {it} under `hold` of {whose}, so that "
        f"{keeps}"
    )


def _gone(spec: Spec, prop: Property, reads: Iterable[Definition]) -> set[str]:
    """The signals for want of which a property holds at each of its deadlines, which carry their keys."""
    carried = {by for each in reads if each.changes for by in each.by}
    kept = lasting(spec, carried)
    if present(prop.formula, without_signals(kept)) is not True:
        return set()
    lacks = lacking(spec.derive, kept.__contains__)
    keys = {c.key for atom in prop.atoms for c in atom.constraints} - kept
    return {name for key in keys for name in lacks.get(key, (key,))}
