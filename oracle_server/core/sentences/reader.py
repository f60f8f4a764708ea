"""Reads a sentence piece by piece: its words, durations, and the formulas that stand in it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import NoReturn

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import WORDS, first_ahead
from oracle_server.core.formula.foreign import UNITS
from oracle_server.core.formula.names import Names
from oracle_server.core.formula.parse import MAX_DISTANCE, read_part
from oracle_server.core.formula.tree import NANOSECONDS, Atom, Constraint, Formula, Time
from oracle_server.core.nearest import nearest
from oracle_server.core.sentences.tokens import Token, place, tokens

STEPS = ("step", "steps", "tick", "ticks")
"""What counts steps behind a number."""
MOST_NESTED = 40
"""Brackets within brackets."""
_MOST_SHOWN = 120
_WORDS = {
    "nanosecond": "ns", "microsecond": "us", "millisecond": "ms", "second": "s", "minute": "min", "hour": "h",
    "microsec": "us", "millisec": "ms", "sec": "s",
}  # fmt: skip
"""The units of time in words, which FRETish has in any case, and of one or of several."""


@dataclass(frozen=True, slots=True)
class Meant:
    """What a sentence stands for: a formula, what its bounds count, and the derived signals that it reads.

    `states` are what its scope and its condition take to last from one step to the next.
    """

    formula: Formula
    time: Time
    measures: tuple[Definition, ...] = ()
    states: tuple[Formula, ...] = ()


@dataclass(slots=True)
class Reader:
    """The pieces of a text, `at` which it is; `names` are those of `define:`, `streams` map theirs to their groups.

    `measures` are the derived signals that were made on the way, each with the `name` of the property before its own;
    `states` is what was read on the way that is taken to last.
    """

    text: str
    pieces: Sequence[Token]
    names: Names
    streams: Mapping[str, str]
    time: Time = "steps"
    at: int = 0
    name: str = ""
    measures: list[Definition] = field(default_factory=list)
    states: list[Formula] = field(default_factory=list)
    depth: int = 0

    @property
    def next(self) -> Token:
        """The piece that is read next."""
        return self.pieces[self.at]

    def take(self) -> Token:
        """Read a piece."""
        found = self.next
        self.at += found.kind != ""
        return found

    def word(self, *words: str) -> Token | None:
        """Read one of some words, in any case; None where none of them comes."""
        return self.take() if self.next.text.lower() in words else None

    def phrase(self, *words: str) -> Token | None:
        """Read some words that follow each other; None where they do not come, all of them."""
        found = self.pieces[self.at : self.at + len(words)]
        if [piece.text.lower() for piece in found] != [*words]:
            return None
        self.at += len(words)
        return found[0]

    def refuse(self, message: str, piece: Token | None = None, known: Collection[str] = ()) -> NoReturn:
        """Raise what is wrong at a piece, the next one by default, with the nearest word and what was understood."""
        piece = piece or self.next
        near = nearest(piece.text, known, 0.6) if piece.kind == "word" else ""
        message += f"; {near}" if near else ""
        raise FormulaError(message + self._understood(piece.start), *place(self.text, piece.start))

    def _understood(self, end: int) -> str:
        """The part of the text that was understood, at the end of a message."""
        before = " ".join(self.text[:end].split())
        before = before if len(before) <= _MOST_SHOWN else f"… {before[-_MOST_SHOWN:]}"
        return f"; understood so far: `{before}`" if before else ""

    def shown(self, piece: Token | None = None) -> str:
        """A piece in a message."""
        piece = piece or self.next
        text = piece.text if len(piece.text) <= 40 else piece.text[:40] + "…"
        return f"`{text}`" if piece.kind else "the end"

    def end(self, what: str) -> None:
        """Refuse what stands behind the end."""
        if self.next.kind:
            self.refuse(f"{self.shown()} is not expected here: {what}")

    def inside(self, group: Token) -> Reader:
        """A reader of what stands between brackets, which shares what is made on the way."""
        if self.depth >= MOST_NESTED:
            self.refuse(f"parentheses are nested more than {MOST_NESTED} deep", group)
        return replace(self, pieces=tokens(self.text, group.start + 1, group.end - 1), at=0, depth=self.depth + 1)

    def formula(self, start: int, end: int) -> Formula:
        """The formula that stands from one character to another, which must not wait for what comes."""
        if not self.text[start:end].strip():
            self.refuse("here stands a formula, as in `{mode: AUTO}`, and not the end")
        line, column = place(self.text, start)
        before = "\n" * (line - 1) + " " * (column - 1)
        try:
            found = read_part(before + self.text[start:end], self.time, self.names)
        except FormulaError as error:
            raise FormulaError(
                f"{error.message}{self._understood(start)}", error.line, error.column, told=error.told
            ) from None
        ahead = first_ahead(found)
        if ahead is not None:
            word = WORDS[type(ahead)]
            message = f"`{word}` waits for what comes; within a sentence stands what holds at a step, or did before"
            raise FormulaError(message, *ahead.at)
        return found

    def atom(self) -> Formula:
        """An atom in braces, or a name of `define:` with its variables."""
        piece = self.take()
        end = piece.end
        if piece.kind == "word":
            if piece.text not in self.names.known:
                self._unknown(piece)
            end = self.take().end if self.next.kind == "(" else end
        return self.formula(piece.start, end)

    def _unknown(self, piece: Token) -> NoReturn:
        names = self.names
        if piece.text in names.below or piece.text == names.reading:
            self.refuse(f"`{piece.text}` can't be used here", piece)
        self.refuse(
            f"there is no name `{piece.text}`: `define:` gives one, as in `{piece.text}: '{{speed > 0.1}}'`, and a "
            f"signal stands in braces, as `{{{piece.text}}}`",
            piece,
            names.known,
        )

    def stream(self) -> Formula:
        """A stream's name, and what its event must meet, in braces."""
        piece = self.take()
        group = self.streams.get(piece.text)
        if group is None:
            known = nearest(piece.text, self.streams, 0.6)
            message = f"there is no stream {piece.text}{f'; {known}' if known else ' in this spec'}"
            self.refuse(message, piece)
        at = place(self.text, piece.start)
        own: tuple[Constraint, ...] = (Constraint(group, "==", piece.text),)
        if self.next.kind == "{":
            atom = self.atom()
            assert isinstance(atom, Atom)  # noqa: S101 -- braces hold one atom, or can't be read
            own += atom.constraints
        if group != "topic" and not any(c.key == "kind" for c in own):
            kind = "request" if group == "service" else "goal"
            kinds = "a service has requests and responses"
            if group != "service":
                kinds = "an action has events of several kinds"
            self.refuse(f"which event is meant? {kinds}: write `{piece.text} {{kind: {kind}}}`", piece)
        return Atom((*own, *tree.demanded(own)), at)

    def duration(self) -> tuple[int, Time]:
        """A duration in nanoseconds, or a number of steps, and which of both it is."""
        piece = self.take()
        if piece.kind != "number":
            self.refuse(f"here stands a time, such as `60s` or `5 steps`, and not {self.shown(piece)}", piece)
        digits = piece.text.rstrip("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ")
        unit = piece.text[len(digits) :] or (self.take().text if self.next.kind == "word" else "")
        if unit.lower() in STEPS:
            return self._steps(digits, piece), "steps"
        known = unit if unit in NANOSECONDS else _WORDS.get(unit.lower().removesuffix("s"))
        if known is None:
            what = f"`{unit}` is no unit of time" if unit else "a unit is missing"
            small = unit.lower()
            number, meant = digits[:20], small if small in NANOSECONDS else UNITS.get(small)
            found = f"`{number}{meant}`" if meant else f"`{number}s`, `{number}ms` or `{number} steps`"
            self.refuse(f"{what}: write {found}", piece)
        if len(digits) > 40:
            self.refuse("the time is too long", piece)
        exact = Fraction(digits) * NANOSECONDS[known]
        if exact != int(exact) or exact > MAX_DISTANCE:
            self.refuse(f"the time {piece.text} is finer than a nanosecond, or too long", piece)
        return int(exact), "seconds"

    def _steps(self, digits: str, piece: Token) -> int:
        if not digits.isdigit() or len(digits) > 18:
            self.refuse(f"steps are counted in whole numbers, and not {digits[:20]}", piece)
        return int(digits)
