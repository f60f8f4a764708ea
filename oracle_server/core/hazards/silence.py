"""Properties of what comes often enough that can't see that nothing comes.

What else they read is gone by then, or they are judged at messages alone.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence

from oracle_server.core.atoms import meets
from oracle_server.core.comparisons import turned
from oracle_server.core.derived.arithmetic import Arithmetic
from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.lacking import lacking
from oracle_server.core.derived.samples import Lack
from oracle_server.core.derived.window import Session
from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.ahead import Obligation, looks_ahead, obligation
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    STEP,
    Always,
    Any,
    Atom,
    Bound,
    Forall,
    Formula,
    Implies,
    Limit,
    Not,
    Once,
    Ref,
    Scalar,
    Signal,
    Until,
    atoms,
    children,
    walk,
)
from oracle_server.core.hazards.lacks import quoted
from oracle_server.core.hazards.withholding import lasting, present, without_signals
from oracle_server.core.kinds import RESERVED
from oracle_server.core.spec import Property, Spec

_MORE = {"age": (">", ">="), "rate": ("<", "<="), "count": ("<", "<=")}
"""The comparisons that silence makes true; it makes the others of these signals false."""
_LASTING: Mapping[str, re.Pattern[str]] = {
    "pattern": re.compile(r"\balways\b"),
    "requirement": re.compile(r"\bshall\s+(always|never)\b", re.IGNORECASE),
}
"""What sentences have that deadlines can break; all others are about messages."""


def unseen_silence(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of properties that say how long nothing may come, and that no deadline violates."""
    for i, prop in enumerate(spec.properties):
        if prop.numeric or prop.external:
            continue
        names = frozenset(spec.derived_of(prop))
        reads = [each for each in spec.derive if each.name in names]
        owed = obligation(prop.formula)
        if owed is None:
            why = _why_gone(spec, prop, reads) or _why_at_messages(spec, prop, reads) or _why_computed(spec, prop)
        else:
            why = _why_awaited(spec, prop, reads, owed)
        told = [f"no deadline violates it, so that silence is not told: {why}"] if why else []
        for message in told or _comes_again(spec, prop, reads):
            text = f"formula of '{prop.id}': {message}"
            yield SpecProblem(("properties", i, "formula"), text, severity="warning", kind="vacuous")


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
    lasts = _LASTING.get(prop.says)
    is_sentence = lasts is not None and not lasts.search(prop.text)
    if prop.time == "seconds":
        formula = _at_steps(prop.formula) if is_sentence and not prop.measures else None
    else:
        formula = None if _is_meant(prop) else prop.formula
    broken = _broken(spec, formula, reads) if formula is not None else set()
    if not broken:
        return ""
    if is_sentence:
        lead = f"such a {prop.says} is about messages; write what must hold with"
        either = "`always`, as `always not {…}`" if prop.says == "pattern" else "`always` or `never`, or as a formula"
        return f"{_while_silent(broken)}, and {lead} {either}, and `time: seconds`"
    return f"{_while_silent(broken)}, and steps are messages; write `time: seconds`"


def _why_awaited(spec: Spec, prop: Property, reads: Iterable[Definition], owed: Obligation) -> str:
    """Why a property that asks for what silence would break does not see it; empty where it does, or is meant not to.

    What waits for what comes is asked for, and judged, at messages, whatever its bounds count.
    """
    if _is_meant(prop):
        return ""
    unasked = _hurt(spec, Not(owed.trigger), reads) if owed.trigger is not None else set()
    if unasked:
        return (
            f"{_while_silent(unasked)}, and what waits for what comes is asked for at messages; name the stream at "
            "whose messages it is meant, as in `{topic: /odom} and {idle > 5} -> …`, or ask it of the past, as in "
            "`{idle > 8} -> once[:3s] {stop}`, with `time: seconds`"
        )
    if prop.says != "formula":
        return ""
    broken = set[str]()
    for node in walk(owed.goal):
        kept = node.operand if isinstance(node, Always) else node.left if isinstance(node, Until) else None
        if kept is not None and not looks_ahead(kept):
            broken |= _hurt(spec, kept, reads)
    if not broken:
        return ""
    awaits = "what waits for what comes is judged at messages"
    mend = _of_the_past(prop, owed) or "once[:10s] {start} -> {…}"
    return f"{_while_silent(broken)}, and {awaits}; ask it of the past, as in `{mend}`, with `time: seconds`"


def _hurt(spec: Spec, formula: Formula, reads: Iterable[Definition]) -> set[str]:
    """The signals by which silence would break a formula, those that are computed of a rate or count among them."""
    return _broken(spec, formula, reads) | {key for key, _ in _computed(spec, formula)}


def _of_the_past(prop: Property, owed: Obligation) -> str:
    """What an obligation asks, said of the past, empty where that is not said so simply."""
    trigger, goal = owed.trigger, owed.goal
    if owed.variables or not isinstance(goal, Always) or looks_ahead(goal.operand):
        return ""
    if trigger is None:
        return render(goal.operand, "seconds")
    if prop.time == "steps" and goal.bound != Bound():
        return ""
    return render(Implies(Once(trigger, goal.bound), goal.operand), "seconds")


def _comes_again(spec: Spec, prop: Property, reads: Sequence[Definition]) -> Iterator[str]:
    """What is said where something is counted that comes with each message of any stream, first where it may not miss.

    Not of an age that the spec derives: that of what is held tells how long it has been otherwise. Nor of the last
    steps, where any stream's count.
    """
    often = [each for each in reads if each.op in ("rate", "count") or each in prop.measures]
    broken, kept = _broken(spec, prop.formula, often), lasting(spec)
    counted = [each for each in often if each.timed and {*each.by} <= kept]
    for each in [e for e in often if e.name in broken] or counted if len(spec.streams) > 1 else ():
        if each.formula and present(each.formula, without_signals(kept)) is None:
            held = {c.key for atom in atoms(each.formula) for c in atom.constraints} & kept
            owner = next((s for s in spec.streams if s.hold & held), spec.streams[0])
            event = render(each.formula)
            mend = f'{{{owner.traits.group}: "{owner.name}"}} and {event}'
            if each in prop.measures:
                mend = f"{owner.name} {event if isinstance(each.formula, Atom) else '{…}'}"
            lead = "silence is not told while other streams speak" if each.name in broken else "it counts other streams"
            yield (
                f"{lead}: `{event}` comes again at each of their messages, "
                f"since {quoted(sorted(held))} {'keeps its value' if len(held) == 1 else 'keep their values'}; write "
                f"it with its stream, as in `{mend}`"
            )
            return


def _is_meant(prop: Property) -> bool:
    """Whether a property is judged at messages because it says so, or is asked at them alone."""
    return bool(prop.guards) or prop.engine == "reelay" or (prop.time == "steps" and prop.time_given)


def _while_silent(broken: Collection[str]) -> str:
    return f"{quoted(sorted(broken))} {'changes' if len(broken) == 1 else 'change'} while no message comes"


def _broken(spec: Spec, formula: Formula, reads: Iterable[Definition]) -> set[str]:
    """The signals of a formula by which silence would break it."""
    growing = {each.name: _MORE[each.op] for each in reads if each.op in _MORE and each.changes}
    quiet = without_signals(lasting(spec, {by for each in reads if each.name in growing for by in each.by}))
    if present(formula, quiet) is True:
        return set()
    return {
        c.key
        for atom, wanted in _signed(formula)
        if quiet(atom) is not False
        for one in atom.constraints
        for c in ((one, turned(one)) if isinstance(one.value, Signal) else (one,))
        if c.key in growing and c.op not in ("==", "!=") and (c.op in growing[c.key]) is not wanted
    }


def _why_computed(spec: Spec, prop: Property) -> str:
    """Why a property that silence would violate by what is computed of a rate or count is judged at messages alone."""
    for key, of in () if _is_meant(prop) else _computed(spec, prop.formula):
        return (
            f"`{key}` is computed of `{of}`, which changes while no message comes, and an expression has "
            f"no deadlines; compare `{of}` itself, with `time: seconds`"
        )
    return ""


def _computed(spec: Spec, formula: Formula) -> Iterator[tuple[str, str]]:
    """The signals computed of a rate or count by which silence would break a formula, each with one of these."""
    fading = [each for each in spec.derive if each.op in _MORE and each.timed]
    quiet = without_signals(lasting(spec, {by for each in fading for by in each.by}))
    if present(formula, quiet) is True:
        return
    computed = _in_silence(spec, fading)
    for atom, wanted in _signed(formula):
        for c in atom.constraints if quiet(atom) is not False else ():
            if c.key in computed and not isinstance(c.value, Any | Ref | Signal | Limit):
                value, of = computed[c.key]
                if meets(c, value) is not wanted:
                    yield c.key, of


def _in_silence(spec: Spec, fading: Sequence[Definition]) -> dict[str, tuple[Scalar, str]]:
    """What is computed of signals that are `fading` to 0 alone, by its name: its value then, and one of these signals.

    Of what has no value then, as `1 / often`, it is the value of before, while the last sample is in the window.
    """
    last = {each.name: 10**9 / each.over if each.op == "rate" and each.over else 1 for each in fading}
    return _computed_of(spec, last) | _computed_of(spec, dict.fromkeys(last, 0))


def _computed_of(spec: Spec, known: Mapping[str, Scalar]) -> dict[str, tuple[Scalar, str]]:
    """What is computed of these values alone, by its name: its value, and the name of one of these."""
    values, sources = dict(known), {name: name for name in known}
    session = Session()
    for each in spec.derive:
        of = [sources[name] for name in each.operands if name in sources] if each.op == "expression" else []
        value = Arithmetic(each, session).value(0, 0, values, ()) if of else None
        if value is not None and not isinstance(value, Lack):
            values[each.name], sources[each.name] = value, of[0]
    return {name: (values[name], of) for name, of in sources.items() if name not in known}


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
