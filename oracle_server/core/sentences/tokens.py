"""The pieces of a sentence; what stands in brackets is one of them, whose inside is a formula or a list of events."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.foreign import SYMBOLS
from oracle_server.core.formula.tree import Position

_PIECE = re.compile(
    r"""(?P<space>\s+)
    |(?P<stream>[~/][A-Za-z0-9_/]*)
    |(?P<number>\d+(?:\.\d+)?[A-Za-z]*)
    |(?P<word>[^\W\d]\w*)
    |(?P<sign><=>|<->|->|=>|&&|\|\||[&|!:.,;=<>*+%-])""",
    re.VERBOSE | re.ASCII,
)
_CLOSING = {"{": "}", "(": ")", "[": "]"}
_INSIDE = re.compile(r"""(?P<string>"[^"\n]*"|'[^'\n]*')|[{}()\[\]]""")


@dataclass(frozen=True, slots=True)
class Token:
    """A piece of a text from `start` up to `end`; of brackets the `kind` is the opening one, and of the end empty."""

    kind: str
    text: str
    start: int
    end: int


def tokens(text: str, start: int = 0, end: int | None = None) -> list[Token]:
    """The pieces of a part of a text, the last of which is its end. Raises `FormulaError` with line and column."""
    end = len(text) if end is None else end
    found = [*_pieces(text, start, end)]
    last = found[-1].end if found else start
    return [*found, Token("", "", last, last)]


def place(text: str, at: int) -> Position:
    """The line and column of a character."""
    return text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)


def _pieces(text: str, at: int, end: int) -> Iterator[Token]:
    while at < end:
        char = text[at]
        match = _PIECE.match(text, at, end)
        if char in _CLOSING:
            closed = _closed(text, at, end)
            yield Token(char, text[at:closed], at, closed)
            at = closed
        elif match is None or match.lastgroup is None:
            raise FormulaError(_strange(char), *place(text, at))
        else:
            if match.lastgroup != "space":
                yield Token(match.lastgroup, match[0], at, match.end())
            at = match.end()


def _closed(text: str, start: int, end: int) -> int:
    """The place behind the bracket that closes the one that stands at `start`."""
    waiting: list[str] = []
    for match in _INSIDE.finditer(text, start, end):
        mark = match[0]
        if mark in _CLOSING:
            waiting.append(_CLOSING[mark])
        elif not match["string"] and (mark != waiting.pop()):
            break
        if not waiting:
            return match.end()
    raise FormulaError(f"the `{text[start]}` that begins here is not closed", *place(text, start))


def _strange(char: str) -> str:
    if char in "})]":
        return f"this `{char}` closes nothing"
    if char in "\"'":
        return 'a text in quotes stands in an atom\'s braces, as in `{mode: "AUTO"}`'
    word = SYMBOLS.get(char, "")
    return f"{char!r} is no sign of a sentence{f'; write `{word}`' if word in ('and', 'or', 'not') else ''}"
