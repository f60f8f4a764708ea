"""What says less than is meant: of the beginning of a session alone, or of what a state ever was."""

from __future__ import annotations

import re
from collections.abc import Iterator

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.conditions import spine
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    ALL_PAST,
    STEP,
    TRUE,
    And,
    Any,
    Atom,
    Forall,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Since,
    atoms,
)
from oracle_server.core.hazards.withholding import lasting, stays
from oracle_server.core.spec import Property, Spec

_NONE_WITHIN = re.compile(
    r"(?:forall\s*\[[^]]*\]\s*\.\s*)*no\b.*\bwithin\b\s*(?P<time>[^)}\]]+)", re.IGNORECASE | re.DOTALL
)
_PAIR = re.compile(r"\b(requires|forbids)\b", re.IGNORECASE)
_HISTORICALLY = re.compile(r"\s*(?:(?:forall|A)\s*\[[^]]*\]\s*\.\s*)*(?:historically|H)\b\s*[^\s(]")
_GLOBALLY = re.compile(r"\s*(?:forall\s*\[[^]]*\]\s*\.\s*)*globally\b", re.IGNORECASE)
_SCOPED = re.compile(r"(?:forall\s*\[[^]]*\]\s*\.\s*)*(?:after|until|while)\b", re.IGNORECASE)


def at_the_beginning(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `no B within d` without a scope: its time counts from the begin of the session."""
    for i, prop in enumerate(spec.properties):
        found = _NONE_WITHIN.fullmatch(prop.text.strip()) if prop.says == "pattern" else None
        if found is None:
            continue
        time = found["time"].strip()
        message = (
            f"pattern of '{prop.id}': it says nothing of what comes later than {time} after the first event of the "
            "session, from which `within` counts where there is no scope; write `after E: no … within` for the time "
            "after an E, leave `within` out for all times, or write `globally:` before it where the "
            "beginning is meant"
        )
        yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def ever(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `B requires A` and `A forbids B`: they ask whether A ever was, a state that is over or an event."""
    kept = lasting(spec)
    for i, prop in enumerate(spec.properties):
        verb = _PAIR.search(prop.text) if prop.says == "pattern" else None
        if verb is None:
            continue
        scoped = _SCOPED.match(prop.text.strip()) is not None
        for event, state in _asked(prop.formula, scoped=scoped):
            if not stays(state, kept):
                if verb[1].lower() == "requires" and not scoped and not _GLOBALLY.match(prop.text):
                    yield from _once_for_all(i, prop, state)
                continue
            word, asked = verb[1].lower(), state if verb[1].lower() == "requires" else Not(state)
            keys = {c.key for atom in atoms(state) for c in atom.constraints}
            owner = next((s.name for s in spec.streams if s.hold & keys), None)
            coming = f"; where its coming is meant, write it with its stream, as in `{owner} {{…}}`" if owner else ""
            message = (
                f"pattern of '{prop.id}': `{render(state)}` keeps its value, and `{word}` asks whether it ever held up "
                f"to then, also where it holds no more; to ask what holds then, write in its place "
                f"`always {render(Implies(event, asked))}`{coming}"
            )
            yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def _once_for_all(i: int, prop: Property, cause: Formula) -> Iterator[SpecProblem]:
    """Of `B requires A` alone: the first A is enough for good. What is told apart by a variable has its own A."""
    if any(atom.refs for atom in atoms(cause)):
        return
    message = (
        f"pattern of '{prop.id}': the first `{render(cause)}` is enough for all that comes later, so that the property "
        "is never violated after it; write `within …` behind it, or a scope before it, as `after … until …:`, or "
        "`globally:` where once is enough"
    )
    yield SpecProblem(("properties", i, "formula"), message, severity="warning")


def ever_before(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `… -> once A` where A is a state: it asks whether it ever was, and so holds for good."""
    kept = lasting(spec)
    for i, prop in enumerate(spec.properties):
        if prop.says != "formula" or prop.external or prop.numeric:
            continue
        for state in _once(prop.formula):
            keys = {c.key for atom in atoms(state) for c in atom.constraints if c.value is not Any.ANY}
            owner = next((s for s in spec.streams if s.hold & keys), None)
            if owner is None or not stays(state, kept):
                continue
            message = (
                f"formula of '{prop.id}': `{render(state)}` keeps its value, so that `{render(Once(state))}` holds "
                f"for good once it held, also where it holds no more; write `{render(state)}` alone for what holds "
                "then, or, where it may have been long ago, name its stream, as in "
                f"`once {{{owner.traits.group}: {owner.name}, …}}`"
            )
            place = min(atom.at for atom in atoms(state))
            yield SpecProblem(("properties", i, "formula"), message, place, severity="warning")


def always_before(spec: Spec) -> Iterator[SpecProblem]:
    """Warnings of `historically A -> B`, which asks nothing more once A has failed at any step."""
    for i, prop in enumerate(spec.properties):
        begins = _HISTORICALLY.match(prop.text) if prop.says == "formula" else None
        past = _always(prop.formula) if begins is not None and not (prop.external or prop.numeric) else None
        if past is not None:
            message = (
                f"formula of '{prop.id}': `historically` reaches no further than `{render(past.operand, prop.time)}`, "
                "so that nothing is asked any more once that failed at a step; leave `historically` out, since a "
                "formula is asked at every step, or write "
                f"`({render(past, prop.time)}) -> …` where all steps so far are meant"
            )
            place = min(atom.at for atom in atoms(past))
            yield SpecProblem(("properties", i, "formula"), message, place, severity="warning")


def _always(formula: Formula) -> Historically | None:
    """What an implication asks on its left to have held at every step, where that is what it begins with."""
    while isinstance(formula, Forall):
        formula = formula.body
    first = next(spine(formula.left if isinstance(formula, Implies) else TRUE))
    if isinstance(first, Historically) and first.bound == ALL_PAST and isinstance(first.operand, Atom):
        return first
    return None


def _once(formula: Formula) -> Iterator[Formula]:
    """What an implication asks to have held at any time before, on its right."""
    match formula:
        case Forall(_, body):
            yield from _once(body)
        case Implies(_, right):
            yield from _once(right)
            yield from (part.operand for part in spine(right) if isinstance(part, Once) and part.bound == ALL_PAST)


def _asked(formula: Formula, *, scoped: bool) -> Iterator[tuple[Formula, Formula]]:
    """The event of such a pattern without a bound, and what it asks of the past."""
    match formula:
        case Forall(_, body):
            yield from _asked(body, scoped=scoped)
        case Implies(left, right) if left == STEP:
            yield from _asked(right, scoped=scoped)
        case Implies(event, Not(past) | past):
            found = past.operand if isinstance(past, Once) else past.right if isinstance(past, Since) else None
            if found is None or getattr(past, "bound", None) != ALL_PAST:
                return
            if scoped:  # each stands beside its scope
                event, found = _first(event), _first(found)
            yield event, found


def _first(formula: Formula) -> Formula:
    return formula.left if isinstance(formula, And) else formula
