"""Patterns of what comes often enough that can't see that nothing comes: what their scope reads is gone by then."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.derived.lacking import lacking
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import TRUE, Atom
from oracle_server.core.lacks import quoted
from oracle_server.core.spec import Property, Spec
from oracle_server.core.withholding import present


def unseen_silence(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of patterns that hold at each deadline of theirs."""
    holds = frozenset[str]().union(*(stream.hold for stream in spec.streams))
    for i, prop in enumerate(spec.properties):
        awaits = {measure.name for measure in prop.measures if measure.op in ("age", "rate")}
        gone = _gone(spec, prop, holds) if awaits and not looks_ahead(prop.formula) else set()
        if gone:
            it, keeps = ("it", "it keeps its value") if len(gone) == 1 else ("them", "they keep their values")
            message = (
                f"formula of '{prop.id}': silence does not violate it: {quoted(sorted(gone))} "
                f"{'is' if len(gone) == 1 else 'are'} not there when no message comes; name {it} under `hold` of "
                f"{'its stream' if len(gone) == 1 else 'their streams'}, so that {keeps}"
            )
            yield SpecProblem(("properties", i, "formula"), message, severity="warning", kind="vacuous")


def _gone(spec: Spec, prop: Property, holds: frozenset[str]) -> set[str]:
    """The signals for want of which a property holds at each of its deadlines."""
    lacks = lacking(spec.derive, holds.__contains__)
    kept = spec.kept - lacks.keys()

    def then(atom: Atom) -> bool | None:
        return True if atom == TRUE else None if all(c.key in kept for c in atom.constraints) else False

    if present(prop.formula, then) is not True:
        return set()
    keys = {c.key for atom in prop.atoms for c in atom.constraints} - kept
    return {name for key in keys for name in lacks.get(key, (key,))}
