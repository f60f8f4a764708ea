"""A formula's parts, place by place: which are known to hold or to fail there, and where an atom can decide anything.

An *instant* is the whole formula, or an operand of a temporal operator: its atoms are judged at one and the same step.
What stands below a temporal operator is another instant, of which an outer one knows no more than what always holds.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from oracle_server.core.formula.tree import (
    Always,
    And,
    Atom,
    Eventually,
    Exists,
    Forall,
    Formula,
    Historically,
    Implies,
    Next,
    Not,
    Once,
    Or,
    Pre,
    Relation,
    Since,
    Until,
    children,
    walk,
)
from oracle_server.core.hazards.places import Place, likened
from oracle_server.core.hazards.worlds import Effort, Truth, Worlds

Row = tuple[Truth, ...]
"""The truth of a part, place by place."""
_Part_co = TypeVar("_Part_co", bound=Formula, covariant=True)
TEMPORAL = (Pre, Once, Historically, Since, Next, Eventually, Always, Until)
_MOST_UNSEEN = 3
"""Most variables that have values which were not seen at a time."""


@dataclass(frozen=True, slots=True)
class Occurrence(Generic[_Part_co]):
    """A part where it stands: in which instant, and at which places it can decide what that comes to."""

    part: _Part_co
    instant: Formula
    counts: tuple[bool, ...]


class Instants:
    """The rows of all parts of a formula."""

    def __init__(
        self, formula: Formula, places: Sequence[Place], value: Callable[[Place, Atom], Truth], effort: Effort
    ) -> None:
        """Work out all rows; `value` is what is known of an atom at a place."""
        self._places, self._value, self._effort = places, value, effort
        self._rows: dict[int, Row] = {}
        self._formula = formula
        self._again = {d.name: d.of for place in places for d in place.again.values() if d.op == "last"}
        self._fill(formula)

    def row(self, node: Formula) -> Row:
        """The row of a part of the formula."""
        return self._rows[id(node)]

    def operands(self) -> Iterator[Formula]:
        """All instants, the innermost first."""
        for node in reversed(list(walk(self._formula))):
            if isinstance(node, TEMPORAL):
                yield from children(node)
        yield self._formula

    def occurrences(self, mended: Instants | None = None) -> Iterator[Occurrence[Atom]]:
        """The atoms of all instants.

        With the same formula `mended`, a part counts, too, where it and the one beside it would both be decisive, and
        there neither is: each of two that fail for want of a signal, and are joined by `and`.
        """
        for instant, node, counts in self._leaves(mended):
            if isinstance(node, Atom):
                yield Occurrence(node, instant, counts)

    def keeping(self) -> Iterator[Occurrence[Since | Historically]]:
        """The operators of all instants that ask for something at every step."""
        for instant, node, counts in self._leaves():
            if isinstance(node, Since | Historically):
                yield Occurrence(node, instant, counts)

    def _leaves(self, mended: Instants | None = None) -> Iterator[tuple[Formula, Formula, tuple[bool, ...]]]:
        """Each instant with its atoms and temporal operators, and the places at which they count."""
        everywhere = (True,) * len(self._places)
        for instant in self.operands():
            for node, counts in self._below(instant, everywhere, mended):
                yield instant, node, counts

    def _below(
        self, node: Formula, counts: tuple[bool, ...], mended: Instants | None
    ) -> Iterator[tuple[Formula, tuple[bool, ...]]]:
        """The atoms and temporal operators below a part that counts at some places, within its instant."""
        match node:
            case Not(operand) | Exists(_, operand) | Forall(_, operand):
                yield from self._below(operand, counts, mended)
            case And(left, right):
                yield from self._both((left, False), (right, False), counts, mended)
            case Or(left, right):
                yield from self._both((left, True), (right, True), counts, mended)
            case Implies(left, right):
                yield from self._both((left, False), (right, True), counts, mended)
            case _:
                yield node, counts

    def _both(
        self,
        left: tuple[Formula, bool],
        right: tuple[Formula, bool],
        counts: tuple[bool, ...],
        mended: Instants | None,
    ) -> Iterator[tuple[Formula, tuple[bool, ...]]]:
        """Those of two operands; a side counts where the other does not have the value that decides alone."""
        together = (False,) * len(counts) if mended is None else self._together(left, right, mended)
        for side, (other, decisive) in ((left, right), (right, left)):
            alone = zip(self.row(other), together, strict=True)
            here = tuple(c and (v is not decisive or both) for c, (v, both) in zip(counts, alone, strict=True))
            yield from self._below(side[0], here, mended)

    def _together(self, left: tuple[Formula, bool], right: tuple[Formula, bool], mended: Instants) -> tuple[bool, ...]:
        """Where both operands have the value that decides alone, and neither has it in the other formula."""
        sides = [
            zip(self.row(node), mended.row(node), (decisive,) * len(self._places), strict=True)
            for node, decisive in (left, right)
        ]
        return tuple(
            all(value is decisive and other is not decisive for value, other, decisive in both)
            for both in zip(*sides, strict=True)
        )

    def _fill(self, formula: Formula) -> None:
        instants = {id(node) for node in self.operands()}
        for node in reversed(list(walk(formula))):  # children stand behind their parents
            row = self._compute(node, self.row)
            if isinstance(node, Exists | Forall):
                row = _quantified(node, row, self._unseen(node.body, frozenset((node.variable,))))
            self._rows[id(node)] = self._by_worlds(node, row) if id(node) in instants and None in row else row

    def _by_worlds(self, instant: Formula, row: Row) -> Row:
        """An instant's row, with what follows from its atoms together where not from each of them."""
        worlds = Worlds(instant, self._again)
        if not worlds.telling:
            return row
        like = likened(worlds.keys, self._places)
        open_at = {id(place): place for place, value in zip(like, row, strict=True) if value is None}
        found = {key: worlds.truth(place, self._value, self._effort) for key, place in open_at.items()}
        return tuple(found[id(p)] if value is None else value for p, value in zip(like, row, strict=True))

    def _unseen(self, node: Formula, variables: frozenset[str]) -> Row:
        """The row of a part where these variables have values that no event has had."""
        self._effort.left -= 1 + len(self._places) // 50
        if self._effort.left < 0:
            return (None,) * len(self._places)
        if isinstance(node, Atom) and any(name in variables for _, name in node.refs):
            return (False,) * len(self._places)
        if isinstance(node, Atom) or not variables:
            return self.row(node)
        if isinstance(node, Exists | Forall):
            outer = variables - {node.variable}
            row = self._unseen(node.body, outer)
            inner = row if len(outer) == _MOST_UNSEEN else self._unseen(node.body, outer | {node.variable})
            return _quantified(node, row, inner)
        return self._compute(node, lambda part: self._unseen(part, variables))

    def _compute(self, node: Formula, row: Callable[[Formula], Row]) -> Row:  # noqa: C901, PLR0911, PLR0912 -- a case a node
        """The row of a part by those of its operands: of a quantifier, what holds for any value."""
        match node:
            case Atom():
                like = likened(node, self._places)
                known = {id(place): self._value(place, node) for place in {id(p): p for p in like}.values()}
                return tuple(known[id(place)] for place in like)
            case Relation():
                return (None,) * len(self._places)
            case Not(operand):
                return _negated(row(operand))
            case And(left, right):
                return tuple(map(_and, row(left), row(right)))
            case Or(left, right):
                return tuple(map(_or, row(left), row(right)))
            case Implies(left, right):
                return tuple(map(_or, _negated(row(left)), row(right)))
            case Exists(_, body) | Forall(_, body):
                return row(body)
            case Pre(operand):
                return _never(row(operand))
            case Once(operand, bound):
                return _ever(row(operand), now=bound.lower == 0)
            case Historically(operand, bound):
                return _negated(_ever(_negated(row(operand)), now=bound.lower == 0))
            case Since(left, right, bound):
                return _since(row(left), row(right), now=bound.lower == 0)
            case Next(operand):
                return _never(row(operand))
            case Eventually(operand, bound):
                return _ever(row(operand), now=bound.lower == 0)
            case Always(operand, bound):
                return _negated(_ever(_negated(row(operand)), now=bound.lower == 0))
            case Until(left, right, bound):
                return _since(row(left), row(right), now=bound.lower == 0)


def _quantified(node: Exists | Forall, body: Row, unseen: Row) -> Row:
    """A quantifier's row, by that of its body for any value, and that for a value that no event has had."""
    decisive = isinstance(node, Exists)
    return tuple(u if b is None and u is decisive else b for b, u in zip(body, unseen, strict=True))


def _never(operand: Row) -> Row:
    """False where the operand holds nowhere."""
    return tuple(False if all(v is False for v in operand) else None for _ in operand)


def _ever(operand: Row, *, now: bool) -> Row:
    """`once`: true where its operand holds now, if now is within the bound."""
    return tuple(True if now and here else ever for here, ever in zip(operand, _never(operand), strict=True))


def _since(left: Row, right: Row, *, now: bool) -> Row:
    begun = _ever(right, now=now)
    ended = (p is False and not (now and q is not False) for p, q in zip(left, right, strict=True))
    return tuple(False if end else ever for end, ever in zip(ended, begun, strict=True))


def _negated(row: Row) -> Row:
    return tuple(None if v is None else not v for v in row)


def _and(left: Truth, right: Truth) -> Truth:
    if left is False or right is False:
        return False
    return None if left is None or right is None else True


def _or(left: Truth, right: Truth) -> Truth:
    if left is True or right is True:
        return True
    return None if left is None or right is None else False
