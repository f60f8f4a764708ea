"""Regular expressions by their derivatives: what is left to come behind a letter."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from oracle_server.core.errors import FormulaError
from oracle_server.core.machines.table import MAX_STATES

MAX_TERMS = 100_000
"""Terms that one expression may need."""
MAX_PARTS_LOOKED_AT = 2_000_000
"""The same of what is put together on the way: terms may have many parts."""
TOO_LARGE = f"the sequence has more than {MAX_STATES:,} states: shorten its counts, or make several of it"


class Term:
    """A regular expression; equal ones are one object. `nullable`: it has the empty word."""

    __slots__ = ("kind", "nullable", "parts", "place")

    def __init__(self, kind: str, parts: tuple[Any, ...], place: int, *, nullable: bool) -> None:
        self.kind, self.parts, self.place, self.nullable = kind, parts, place, nullable


NOTHING: Final = Term("nothing", (), 0, nullable=False)
"""No word."""
EMPTY: Final = Term("empty", (), 1, nullable=True)
"""The empty word alone."""


class Terms:
    """Terms as they are made, so simplified that there are finitely many derivatives of each."""

    def __init__(self) -> None:
        self._known: dict[object, Term] = {}
        self._derivatives: dict[tuple[int, int], Term] = {}
        self._parts = 0
        self._all = self.other(NOTHING)

    def letter(self, letter: int) -> Term:
        """One letter."""
        return self._made("letter", (letter,), nullable=False)

    def behind(self, left: Term, right: Term) -> Term:
        """One behind the other."""
        if left is NOTHING or right is NOTHING:
            return NOTHING
        if left is EMPTY or right is EMPTY:
            return right if left is EMPTY else left
        if left.kind == "behind":
            first, second = left.parts
            return self.behind(first, self.behind(second, right))
        return self._made("behind", (left, right), nullable=left.nullable and right.nullable)

    def either(self, terms: Iterable[Term]) -> Term:
        """Any of some."""
        found = {t for t in _flat("either", terms) if t is not NOTHING}
        if self._all in found:
            return self._all
        return self._set("either", found, NOTHING, nullable=any(t.nullable for t in found))

    def both(self, terms: Iterable[Term]) -> Term:
        """All of some at once."""
        found = {t for t in _flat("both", terms) if t is not self._all}
        if NOTHING in found:
            return NOTHING
        return self._set("both", found, self._all, nullable=all(t.nullable for t in found))

    def other(self, term: Term) -> Term:
        """All but one."""
        if term.kind == "other":
            inner: Term = term.parts[0]
            return inner
        return self._made("other", (term,), nullable=not term.nullable)

    def repeated(self, term: Term, low: int, high: int | None) -> Term:
        """One so many times behind itself, `high` None for any."""
        if high == 0 or term is EMPTY or (term is NOTHING and not low):
            return EMPTY
        if term is NOTHING or (low == high == 1):
            return term
        if term.nullable:
            low = 0
        if term.kind == "repeated" and term.parts[1:] == (0, None) and (high is None or high > 0):
            return term
        return self._made("repeated", (term, low, high), nullable=not low)

    def derivative(self, term: Term, letter: int) -> Term:
        """What is left of a term behind a letter. Raises `FormulaError` where it needs too much."""
        return self._behind(term, letter)

    def _behind(self, term: Term, letter: int) -> Term:
        known = self._derivatives.get((term.place, letter))
        if known is None:
            known = self._derivatives[term.place, letter] = self._derived(term, letter)
        return known

    def _derived(self, term: Term, letter: int) -> Term:  # noqa: PLR0911 -- a case a kind
        parts = term.parts
        match term.kind, parts:
            case "letter", (own,):
                return EMPTY if own == letter else NOTHING
            case "behind", (Term() as left, Term() as right):
                first = self.behind(self._behind(left, letter), right)
                return self.either([first, self._behind(right, letter)]) if left.nullable else first
            case "either", _:
                return self.either(self._behind(t, letter) for t in parts if isinstance(t, Term))
            case "both", _:
                return self.both(self._behind(t, letter) for t in parts if isinstance(t, Term))
            case "other", (Term() as inner,):
                return self.other(self._behind(inner, letter))
            case "repeated", (Term() as inner, int(low), high):
                rest = self.repeated(inner, max(low - 1, 0), None if high is None else high - 1)
                return self.behind(self._behind(inner, letter), rest)
        return NOTHING

    def _set(self, kind: str, found: set[Term], none: Term, *, nullable: bool) -> Term:
        self._parts += len(found)
        if self._parts > MAX_PARTS_LOOKED_AT:
            raise FormulaError(TOO_LARGE)
        if len(found) < 2:
            return next(iter(found), none)
        return self._made(kind, tuple(sorted(found, key=lambda t: t.place)), nullable=nullable)

    def _made(self, kind: str, parts: tuple[Any, ...], *, nullable: bool) -> Term:
        key = (kind, *(part.place if isinstance(part, Term) else ("", part) for part in parts))
        known = self._known.get(key)
        if known is None:
            if len(self._known) >= MAX_TERMS:
                raise FormulaError(TOO_LARGE)
            known = self._known[key] = Term(kind, parts, len(self._known) + 2, nullable=nullable)
        return known


def _flat(kind: str, terms: Iterable[Term]) -> Iterable[Term]:
    for term in terms:
        if term.kind == kind:
            yield from (part for part in term.parts if isinstance(part, Term))
        else:
            yield term
