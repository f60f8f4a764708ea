"""What a formula comes to at one event whatever its signals are, where several of its atoms read the same ones.

By themselves `{s != 1}` and `{s != 2}` may each hold or not, yet one of them does wherever `s` is there. So a signal
that several atoms read is given each value that they tell apart, one after another, and none where it may be absent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

from oracle_server.core.atoms import meets
from oracle_server.core.comparisons import met, others, signs
from oracle_server.core.formula.tree import (
    Always,
    And,
    Atom,
    Bound,
    Constraint,
    Eventually,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Limit,
    Not,
    Once,
    Or,
    Ref,
    Signal,
    Since,
    Until,
    walk,
)
from oracle_server.core.hazards.places import Place

Truth = bool | None
"""Whether a part holds at every event of a place (true), at none (false), or that is not known."""
_Fact = tuple[str, object]
"""That a signal meets a constraint, or has the value of a quantifier's variable: a number for each quantifier."""
_World = Mapping[_Fact, bool]
_Run = Callable[[_World, Sequence[Truth]], Truth]
"""A world, and what is known of each atom whatever the world is, to what a part comes to there."""
_MOST = 256
"""Most combinations of values that are tried for a place."""
_MOST_JOINED = 4
"""Most variables with whose values a signal is compared; of others nothing is known."""
_MOST_COMPARED = 2
"""Most signals with which one is compared, of which something is known."""
_LARGEST = 100
"""Most constraints of an instant that is looked at."""


@dataclass(slots=True)
class Effort:
    """How many parts of formulas may still be worked out."""

    left: int = 300_000


class Worlds:
    """An instant over all that its signals can be at an event; of the past nothing is known."""

    def __init__(self, instant: Formula, again: Mapping[str, str]) -> None:
        """Look at an instant; `again` has the signals whose last samples some derived ones are, by their names."""
        self._again = again
        self._atoms: list[Atom] = []
        self._facts: list[list[_Fact]] = []
        self._quantifiers = 0
        self._size = sum(1 for _ in walk(instant))
        self._run = self._compiled(instant, {})
        readers: dict[str, int] = {}
        for atom in self._atoms:
            for key in {c.key for c in atom.constraints}:
                readers[again.get(key, key)] = readers.get(again.get(key, key), 0) + 1
        self._shared = {key: dict[_Fact, Constraint]() for key, count in readers.items() if count > 1}
        for fact, constraint in self._asked():
            key = again.get(constraint.key, constraint.key)
            if key in self._shared:
                self._shared[key][fact] = constraint
        self.keys = Atom(tuple(c for atom in self._atoms for c in atom.constraints))
        """An atom with all constraints."""
        self.telling = bool(self._shared) and len(self.keys.constraints) <= _LARGEST
        """Whether anything can follow from its atoms together."""

    def truth(self, place: Place, value: Callable[[Place, Atom], Truth], effort: Effort) -> Truth:
        """What the instant comes to at a place; `value` is what is known of an atom there."""
        effort.left -= self._size
        if effort.left < 0:
            return None
        shared = [(key, asked) for key, asked in self._shared_at(place).items() if key not in place.constants]
        choices = [list(_choices(key, asked, place)) for key, asked in shared]
        count = math.prod(len(each) for each in choices)
        if count == 1 or count > _MOST or count * self._size > effort.left:
            return None
        effort.left -= count * self._size
        known = [value(place, atom) for atom in self._atoms]
        sure = {fact: True for fact, constraint in self._asked() if _is_sure(place, constraint)}
        first: Truth = None
        for chosen in product(*choices):
            world = dict(sure)
            for each in chosen:
                world |= each
            found = self._run(world, known)
            if found is None or found is not (first if first is not None else found):
                return None
            first = found
        return first

    def _shared_at(self, place: Place) -> Mapping[str, Mapping[_Fact, Constraint]]:
        """What is asked of each value: of a signal and its last sample together, where an event here is that."""
        if not self._again:
            return self._shared
        found: dict[str, dict[_Fact, Constraint]] = {}
        for key, asked in self._shared.items():
            for fact, constraint in asked.items():
                own = constraint.key != key and constraint.key not in place.again
                found.setdefault(constraint.key if own else key, {})[fact] = constraint
        return found

    def _asked(self) -> Iterator[tuple[_Fact, Constraint]]:
        for atom, facts in zip(self._atoms, self._facts, strict=True):
            yield from zip(facts, atom.constraints, strict=True)

    def _compiled(self, node: Formula, scope: Mapping[str, int]) -> _Run:  # noqa: PLR0911 -- a case a node
        match node:
            case Atom():
                return self._atom(node, scope)
            case Not(operand):
                inner = self._compiled(operand, scope)
                return lambda world, known: _negated(inner(world, known))
            case And(left, right) | Or(left, right) | Implies(left, right):
                one, two, join = self._compiled(left, scope), self._compiled(right, scope), _JOINS[type(node)]
                return lambda world, known: join(one(world, known), two(world, known))
            case Exists(variable, body) | Forall(variable, body):
                # as the whole holds for each value of its own, whichever value decides the quantifier
                self._quantifiers += 1
                return self._compiled(body, {**scope, variable: self._quantifiers})
            case Since(left, right, bound) | Until(left, right, bound):
                kept, begun = self._compiled(left, scope), self._compiled(right, scope)
                return _lasting(kept, begun if bound.lower == 0 else None)
            case Once(operand, Bound(lower=0)) | Eventually(operand, Bound(lower=0)):
                now = self._compiled(operand, scope)
                return lambda world, known: now(world, known) or None
            case Historically(operand, Bound(lower=0)) | Always(operand, Bound(lower=0)):
                now = self._compiled(operand, scope)
                return lambda world, known: None if now(world, known) is not False else False
            case _:
                return lambda _world, _known: None

    def _atom(self, atom: Atom, scope: Mapping[str, int]) -> _Run:
        index = len(self._atoms)
        facts = [(c.key, _asked_of(c, scope)) for c in atom.constraints]
        self._atoms.append(atom)
        self._facts.append(facts)

        def run(world: _World, known: Sequence[Truth]) -> Truth:
            if known[index] is not None:
                return known[index]
            found = [world.get(fact) for fact in facts]
            return False if False in found else None if None in found else True

        return run


def _choices(key: str, asked: Mapping[_Fact, Constraint], place: Place) -> Iterator[_World]:
    """What the constraints on a signal can come to, by the values that it can have."""
    plain = {fact: c for fact, c in asked.items() if not isinstance(c.value, Ref | Signal | Limit)}
    variables = list(dict.fromkeys(variable for (_, variable), c in asked.items() if isinstance(c.value, Ref)))
    variables = variables[:_MOST_JOINED]
    compared = {fact: c for fact, c in asked.items() if isinstance(c.value, Signal)}
    absent = list(_absent(key, asked, place))
    values = place.range(key).telling(list(plain.values()))
    for found, number in {(tuple(meets(c, v) for c in plain.values()), not isinstance(v, str | bool)) for v in values}:
        for orders in _orders(key, compared, place, number=number):
            for equal in product((False, True), repeat=len(variables)):
                same = dict(zip(variables, equal, strict=True))
                joined = {fact: same[fact[1]] for fact in asked if fact[1] in same}
                world = {**dict(zip(plain, found, strict=True)), **joined, **orders}
                yield from ({**world, **gone} for gone in absent)
    if key not in place.always:
        yield {fact: False for fact, c in asked.items() if c.key == key}  # the last sample may be there all the same


def _absent(key: str, asked: Mapping[_Fact, Constraint], place: Place) -> Iterator[_World]:
    """Which of the last samples of a signal that is there may be absent: those by a signal that is not."""
    keyed = dict.fromkeys(c.key for c in asked.values() if c.key != key and place.again[c.key].by)
    for gone in product((False, True), repeat=len(keyed)):
        names = {name for name, is_gone in zip(keyed, gone, strict=True) if is_gone}
        yield {fact: False for fact, c in asked.items() if c.key in names}


def _orders(key: str, compared: Mapping[_Fact, Constraint], place: Place, *, number: bool) -> Iterator[_World]:
    """What comparisons of a signal with others can come to; those with all but a few are not known.

    With one that is no number each is false; where it is absent, its own constraint tells.
    """
    if not number:
        yield dict.fromkeys(compared, False)
        return
    names = others(compared.values())[:_MOST_COMPARED]
    ways = [
        (0,) if name == key else place.signs(key, name) or (*signs(), *(() if place.range(name).is_number else (None,)))
        for name in names
    ]
    for found in product(*ways):
        known = dict(zip(names, found, strict=True))
        yield {
            fact: (sign := known[c.value.name]) is not None and met(c, sign)
            for fact, c in compared.items()
            if isinstance(c.value, Signal) and c.value.name in known
        }


def _asked_of(constraint: Constraint, scope: Mapping[str, int]) -> object:
    if isinstance(constraint.value, Ref):
        return scope.get(constraint.value.name, constraint.value)
    return constraint


def _is_sure(place: Place, constraint: Constraint) -> bool:
    if constraint.key in place.constants and not isinstance(constraint.value, Ref | Limit):
        return meets(constraint, place.constants[constraint.key])
    return place.sure(constraint)


def _lasting(kept: _Run, begun: _Run | None) -> _Run:
    """`since` and `until`: what begins them, or ends them, may do so now, or else all of it is past, or to come."""

    def run(world: _World, known: Sequence[Truth]) -> Truth:
        now = False if begun is None else begun(world, known)
        return True if now is True else False if now is False and kept(world, known) is False else None

    return run


def _negated(value: Truth) -> Truth:
    return None if value is None else not value


def _or(left: Truth, right: Truth) -> Truth:
    if left is True or right is True:
        return True
    return None if left is None or right is None else False


_JOINS: Mapping[type, Callable[[Truth, Truth], Truth]] = {
    And: lambda left, right: _negated(_or(_negated(left), _negated(right))),
    Or: _or,
    Implies: lambda left, right: _or(_negated(left), right),
}
