"""What is taken to last, and does not, since other streams' events lack its signals.

That is the scopes and conditions of sentences, and what `pre` and `next` ask of the step before and after, which may
be of any stream.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.errors import SpecProblem
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    And,
    Atom,
    Exists,
    Forall,
    Formula,
    Implies,
    Next,
    Not,
    Or,
    Position,
    Pre,
    Time,
    atoms,
    walk,
)
from oracle_server.core.hazards.lacks import quoted, whose
from oracle_server.core.hazards.places import Place, names_of, places
from oracle_server.core.hazards.withholding import present
from oracle_server.core.kinds import ACTION, NAMING, OWN, RESERVED
from oracle_server.core.spec import Property, Spec
from oracle_server.core.typed import StreamTypes

_ASKS = {False: "`pre` asks of the step before", True: "`next` asks of the step after"}
_WHATEVER = {False: "whatever was said last", True: "whatever is said later"}


def lapsing(spec: Spec, types: StreamTypes) -> Iterator[SpecProblem]:
    """Warnings about properties of a spec without errors, whose messages have these types."""
    known: dict[Time, list[Place]] = {}
    for i, prop in enumerate(spec.properties):
        before = list(_asked_of_the_step_beside(prop))
        asked = prop.states or before
        if asked and prop.time not in known:
            known[prop.time] = [p for p in places(spec, prop.time, types) if p.stream is not None]
        where = known[prop.time] if asked else []
        found = [said for state in prop.states for said in _lapses(prop, state, where)]
        found += [said for beside in before for said in _differs(prop, beside, where)]
        for message, at in found:
            yield SpecProblem(("properties", i, "formula"), message, at, severity="warning")


def _asked_of_the_step_beside(prop: Property) -> Iterator[Pre | Next]:
    """Each `pre` and `next` of a formula that looks at one step alone."""
    if prop.says == "formula" and not (prop.external or prop.numeric):
        for node in walk(prop.formula):
            if isinstance(node, Pre | Next) and _is_single(node.operand):
                yield node


def _differs(prop: Property, beside: Pre | Next, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """What is said, once, of what is asked of the step before or after: where other streams' events decide it."""
    state, ahead = beside.operand, isinstance(beside, Next)
    open_ = [p for p in where if present(state, p.value) is None]
    for atom in atoms(state):
        named = any(c.key not in NAMING for c in atom.constraints)
        other = [p for p in where if p not in open_ and (p.lacks(atom) if p.allows(atom) else named)]
        if open_ and other:
            keys = sorted({key for place in other for key in place.lacks(atom)} - RESERVED)
            mend = _next_message(state, open_[0]) if ahead else _kept(where, other, atom, keys)
            yield (
                f"formula of '{prop.id}': {_ASKS[ahead]}, which may be a message of any stream: "
                f"`{render(state)}` {'holds' if present(state, other[0].value) else 'is false'} at every event of "
                f"{names_of(other)}, {_WHATEVER[ahead]}; {mend}",
                atom.at,
            )
            return


def _kept(where: Sequence[Place], other: Sequence[Place], atom: Atom, keys: Sequence[str]) -> str:
    """How to make a state last up to the next step, whichever stream that is of."""
    mends = [_mend(where, other, keys)] if keys else []
    mends += [] if all(p.allows(atom) for p in other) else [f"leave the stream out of `{render(atom)}`"]
    return ", and ".join(mends)


def _next_message(state: Formula, place: Place) -> str:
    """How to ask of the next message of a stream alone."""
    stream = place.stream
    if stream is None or not stream.traits.sole:
        return "name the event that is meant: `next (not {…} until ({…} and …))`"
    event = f'{{{stream.traits.group}: "{stream.name}"}}'
    return f"to ask of the next one of {place.name}, write `next (not {event} until ({event} and {render(state)}))`"


def _lapses(prop: Property, state: Formula, where: Sequence[Place]) -> Iterator[tuple[str, Position]]:
    """What is said of a state, once: where it is decided for want of a signal that other events have."""
    open_ = [p for p in where if present(state, p.value) is None]
    if all(_is_of_one_message(prop.formula, place) for place in open_):
        return
    for atom in atoms(state):
        lacking = [p for p in where if p not in open_ and p.allows(atom) and p.lacks(atom)]
        if open_ and lacking:
            keys = sorted({key for place in lacking for key in place.lacks(atom)})
            holds = "holds" if present(state, lacking[0].value) else "is false"
            yield (
                f"formula of '{prop.id}': `{render(state)}` is taken to last, and {holds} at every event of "
                f"{names_of(lacking)}, whatever was said last: {_mend(where, lacking, keys)}",
                atom.at,
            )
            return


def _mend(where: Sequence[Place], lacking: Sequence[Place], keys: Sequence[str]) -> str:
    """How to make a state last that reads such signals; those that actions have of their own are never held."""
    declared = {name for place in where if place.stream is not None for name in place.stream.signals or ()}
    own = [key for key in keys if key in OWN[ACTION] and key not in declared]
    if own:
        return f"{quoted(own)} can't be held: keep what it tells by a machine under `derive`"
    return whose(where, lacking, keys)


def _is_of_one_message(formula: Formula, place: Place) -> bool:
    """Whether a formula is about single messages of a stream, which have all that it reads: nothing needs to last."""
    keys = {c.key for atom in atoms(formula) for c in atom.constraints}
    return _is_single(formula) and keys <= place.own.keys() | RESERVED


def _is_single(formula: Formula) -> bool:
    """Whether a formula looks at one step alone."""
    return all(isinstance(node, Atom | Not | And | Or | Implies | Forall | Exists) for node in walk(formula))
