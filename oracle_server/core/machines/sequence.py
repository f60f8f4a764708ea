"""Machines by the sequence of their events: a regular expression over events, by its derivatives."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import NoReturn

from oracle_server.core.errors import FormulaError
from oracle_server.core.machines.regular import TOO_LARGE, Term, Terms
from oracle_server.core.machines.table import MAX_STATES, Table
from oracle_server.core.nearest import listed, nearest

MATCHED, POSSIBLE, FAILED = "matched", "possible", "failed"
MAX_PARTS = 200
"""Names that may stand in a sequence."""
MAX_REPEATED = 1_000
_NESTED = 40
_PIECE = re.compile(r"\s*(?:(?P<name>[A-Za-z_]\w*)|(?P<count>\{[^}]*\}?)|(?P<sign>[|&!()*+?])|(?P<odd>\S))", re.ASCII)
_COUNT = re.compile(r"\{\s*(\d{1,6})\s*(?:(,)\s*(\d{1,6})?\s*)?\}")


def by_sequence(text: str, events: Collection[str]) -> Table:
    """The machine of a sequence, over `events` by their names. Raises `FormulaError` with line and column."""
    reader = _Reader(text, events)
    terms = reader.terms
    whole = reader.read()
    letters = tuple(reader.letters)
    states, rows, found = {whole: 0}, list[list[int]](), [whole]
    for term in found:  # which grows
        rows.append([])
        for letter in range(len(letters)):
            to = terms.derivative(term, letter)
            if len(states) > MAX_STATES:
                raise FormulaError(TOO_LARGE)
            if to not in states:
                states[to] = len(states)
                found.append(to)
            rows[-1].append(states[to])
    return _table(rows, [term.nullable for term in found], letters)


def _table(rows: Sequence[Sequence[int]], final: Sequence[bool], letters: tuple[str, ...]) -> Table:
    alive = _reaching(rows, final)
    if not alive[0]:
        raise FormulaError("nothing can match this sequence: no event could ever be one of it")
    kept = [i for i, lives in enumerate(alive) if lives]
    places = {state: i for i, state in enumerate(kept)}
    failed = len(kept)
    found = tuple({1 << e: places[to] for e, to in enumerate(rows[i]) if alive[to]} for i in kept)
    values = (*(MATCHED if final[i] else POSSIBLE for i in kept), FAILED)
    names = (*(f"{value} {i + 1}" for i, value in enumerate(values[:-1])), FAILED)
    return Table(names, values, letters, (*found, {}), (failed,) * (failed + 1), 0, FAILED)


def _reaching(rows: Sequence[Sequence[int]], final: Sequence[bool]) -> list[bool]:
    """The states from which a final one can be reached."""
    before: list[set[int]] = [set() for _ in rows]
    for state, row in enumerate(rows):
        for to in row:
            before[to].add(state)
    alive = list(final)
    waiting = [i for i, lives in enumerate(alive) if lives]
    while waiting:
        for state in before[waiting.pop()]:
            if not alive[state]:
                alive[state] = True
                waiting.append(state)
    return alive


class _Reader:
    """Reads a sequence: `|` binds least, then `&`, then one behind the other, then `!`, then `*` and its like."""

    def __init__(self, text: str, events: Collection[str]) -> None:
        self.text, self.events = text, events
        self.pieces = list(_PIECE.finditer(text))
        self.at = self.depth = self.parts = 0
        self.letters: dict[str, int] = {}
        self.terms = Terms()

    def read(self) -> Term:
        if not self.pieces:
            raise FormulaError("the sequence is empty: write its events, as in 'open (read | write)* close'")
        found = self._either()
        if self.at < len(self.pieces):
            self._refuse(f"`{self._next}` is not expected here")
        return found

    @property
    def _next(self) -> str:
        return self.pieces[self.at][0].strip() if self.at < len(self.pieces) else ""

    def _take(self, sign: str) -> bool:
        found = self._next == sign
        self.at += found
        return found

    def _either(self) -> Term:
        found = [self._both()]
        while self._take("|"):
            found.append(self._both())
        return self.terms.either(found)

    def _both(self) -> Term:
        found = [self._behind()]
        while self._take("&"):
            found.append(self._behind())
        return self.terms.both(found)

    def _behind(self) -> Term:
        found = [self._other()]
        while self._next and self._next not in "|&)":
            found.append(self._other())
        whole = found.pop()
        for each in reversed(found):
            whole = self.terms.behind(each, whole)
        return whole

    def _other(self) -> Term:
        count = 0
        while self._take("!"):
            count += 1
        found = self._repeated()
        return self.terms.other(found) if count % 2 else found

    def _repeated(self) -> Term:
        found = self._one()
        while (sign := self._next) and sign[0] in "*+?{":
            low, high = {"*": (0, None), "+": (1, None), "?": (0, 1)}.get(sign) or self._count(sign)
            found = self.terms.repeated(found, low, high)
            self.at += 1
        return found

    def _count(self, text: str) -> tuple[int, int | None]:
        match = _COUNT.fullmatch(text)
        if match is None:
            self._refuse(f"a count is written as `{{3}}`, `{{2,}}` or `{{2,5}}`, and not `{text[:20]}`")
        low = int(match[1])
        high = low if match[2] is None else None if match[3] is None else int(match[3])
        if max(low, high or 0) > MAX_REPEATED:
            self._refuse(f"an event is repeated at most {MAX_REPEATED:,} times")
        if high is not None and high < low:
            self._refuse(f"`{text}` is from more to fewer: write `{{{high},{low}}}`")
        return low, high

    def _one(self) -> Term:
        if self._next == "(" and self.depth == _NESTED:
            self._refuse(f"parentheses are nested more than {_NESTED} deep")
        if self._take("("):
            self.depth += 1
            found = self._either()
            if not self._take(")"):
                self._refuse("a `)` is missing")
            self.depth -= 1
            return found
        if self.at == len(self.pieces) or not self.pieces[self.at]["name"]:
            what = f"`{self._next}`" if self._next else "the end"
            self._refuse(f"here stands an event, or several in parentheses, and not {what}")
        name = self._next
        if name not in self.events:
            self._refuse(f"unknown event '{name}'; {unknown_event(name, self.events)}")
        self.parts += 1
        if self.parts > MAX_PARTS:
            self._refuse(f"a sequence has at most {MAX_PARTS} names")
        self.at += 1
        return self.terms.letter(self.letters.setdefault(name, len(self.letters)))

    def _refuse(self, message: str) -> NoReturn:
        at = self.pieces[self.at].end() - len(self._next) if self.at < len(self.pieces) else len(self.text)
        before = self.text[:at]
        understood = " ".join(before.split())
        more = f"; understood so far: `{understood[-120:]}`" if understood else ""
        line = before.count("\n") + 1
        raise FormulaError(message + more, line, at - before.rfind("\n"))


def unknown_event(name: str, events: Collection[str]) -> str:
    """What to say of a name that is no event."""
    hint = nearest(name, events)
    there = f"there are {listed(events)}" if events else "there is none yet"
    return f"{f'{hint} ' if hint else ''}an event is a name of `define`, and {there}"
