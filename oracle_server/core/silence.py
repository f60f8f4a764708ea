"""Properties of what comes often enough that can't see that nothing comes.

What else they read is gone by then, or they are judged at messages alone.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

from oracle_server.core.atoms import meets
from oracle_server.core.comparisons import turned
from oracle_server.core.derived.arithmetic import Arithmetic
from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.lacking import lacking
from oracle_server.core.derived.samples import Lack
from oracle_server.core.derived.window import Session
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import (
    STEP,
    Any,
    Atom,
    Forall,
    Formula,
    Implies,
    Limit,
    Not,
    Ref,
    Scalar,
    Signal,
    children,
)
from oracle_server.core.kinds import RESERVED
from oracle_server.core.lacks import quoted
from oracle_server.core.spec import Property, Spec
from oracle_server.core.withholding import lasting, present, without_signals

_MORE = {"age": (">", ">="), "rate": ("<", "<="), "count": ("<", "<=")}
"""The comparisons that silence makes true; it makes the others of these signals false."""


def unseen_silence(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of properties that say how long nothing may come, and that no deadline violates."""
    for i, prop in enumerate(spec.properties):
        if prop.numeric or prop.external or looks_ahead(prop.formula):
            continue
        names = frozenset(spec.derived_of(prop))
        reads = [each for each in spec.derive if each.name in names]
        why = _why_gone(spec, prop, reads) or _why_at_messages(spec, prop, reads) or _why_computed(spec, prop)
        if why:
            message = f"formula of '{prop.id}': no deadline violates it, so that silence is not told: {why}"
            yield SpecProblem(("properties", i, "formula"), message, severity="warning", kind="vacuous")


def _why_gone(spec: Spec, prop: Property, reads: Iterable[Definition]) -> str:
    """What a property over an age, or a pattern of what comes often enough, lacks at its deadlines; empty for none."""
    measured = {measure.name for measure in prop.measures if measure.op == "rate"}
    if prop.time != "seconds" or not any(each.op == "age" or each.name in measured for each in reads):
        return ""
    gone = _gone(spec, prop, reads)
    return _mend(gone) if gone and (prop.measures or not gone & RESERVED) else ""


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


def _why_at_messages(spec: Spec, prop: Property, reads: Iterable[Definition]) -> str:
    """Why a property that silence would violate is judged at messages alone; empty where it is not, or is meant to be.

    One that guards is asked at what it guards.
    """
    is_sentence = prop.says == "pattern" and not re.search(r"\balways\b", prop.text)
    if prop.time == "seconds":
        formula = _at_steps(prop.formula) if is_sentence and not prop.measures else None
    else:
        formula = None if prop.time_given or prop.guards or prop.engine == "reelay" else prop.formula
    if formula is None:
        return ""
    growing = {each.name: _MORE[each.op] for each in reads if each.op in _MORE and each.changes}
    quiet = without_signals(lasting(spec, {by for each in reads if each.name in growing for by in each.by}))
    if present(formula, quiet) is True:
        return ""
    broken = {
        c.key
        for atom, wanted in _signed(formula)
        if quiet(atom) is not False
        for one in atom.constraints
        for c in ((one, turned(one)) if isinstance(one.value, Signal) else (one,))
        if c.key in growing and c.op not in ("==", "!=") and (c.op in growing[c.key]) is not wanted
    }
    if not broken:
        return ""
    while_silent = f"{quoted(sorted(broken))} {'changes' if len(broken) == 1 else 'change'} while no message comes"
    if is_sentence:
        mend = "write what must hold with `always`, as `always not {…}`, and `time: seconds`"
        return f"{while_silent}, and such a pattern is about messages; {mend}"
    return f"{while_silent}, and steps are messages; write `time: seconds`"


def _why_computed(spec: Spec, prop: Property) -> str:
    """Why a property that silence would violate by what is computed of a rate or count is judged at messages alone."""
    if prop.guards or prop.engine == "reelay" or (prop.time == "steps" and prop.time_given):
        return ""
    fading = [each for each in spec.derive if each.op in _MORE and each.timed]
    quiet = without_signals(lasting(spec, {by for each in fading for by in each.by}))
    if present(prop.formula, quiet) is True:
        return ""
    computed = _in_silence(spec, [each.name for each in fading])
    for atom, wanted in _signed(prop.formula):
        for c in atom.constraints if quiet(atom) is not False else ():
            if c.key in computed and not isinstance(c.value, Any | Ref | Signal | Limit):
                value, of = computed[c.key]
                if meets(c, value) is not wanted:
                    return (
                        f"`{c.key}` is computed of `{of}`, which changes while no message comes, and an expression has "
                        f"no deadlines; compare `{of}` itself, with `time: seconds`"
                    )
    return ""


def _in_silence(spec: Spec, fading: Sequence[str]) -> dict[str, tuple[Scalar, str]]:
    """What is computed of signals that `fading` to 0 alone, by its name: its value then, and one of these signals."""
    values: dict[str, Scalar] = dict.fromkeys(fading, 0)
    sources = {name: name for name in fading}
    session = Session()
    for each in spec.derive:
        of = [sources[name] for name in each.operands if name in sources] if each.op == "expression" else []
        value = Arithmetic(each, session).value(0, 0, values, ()) if of else None
        if value is not None and not isinstance(value, Lack):
            values[each.name], sources[each.name] = value, of[0]
    return {name: (values[name], of) for name, of in sources.items() if name not in fading}


def _at_steps(formula: Formula) -> Formula | None:
    """What a sentence says of steps alone; None where it says it of deadlines, too."""
    match formula:
        case Forall(_, body):
            return _at_steps(body)
        case Implies(left, right) if left == STEP:
            return right
    return None


def _signed(node: Formula, *, wanted: bool = True) -> Iterator[tuple[Atom, bool]]:
    """The atoms, each with whether it is wanted that it holds, or that it does not."""
    match node:
        case Atom():
            yield node, wanted
        case Not(operand):
            yield from _signed(operand, wanted=not wanted)
        case Implies(left, right):
            yield from _signed(left, wanted=not wanted)
            yield from _signed(right, wanted=wanted)
        case _:
            for part in children(node):
                yield from _signed(part, wanted=wanted)
