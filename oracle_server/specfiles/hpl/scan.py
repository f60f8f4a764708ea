"""Reads the text of HPL piece by piece; what a piece is depends on what is asked for at its place."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache
from typing import NoReturn

from oracle_server.specfiles.hpl.tree import HplError

_BETWEEN = re.compile(r"(?:\s+|#(?!\s*(?:id|title|description)\s*:)[^\n]*)*")
_WORD = re.compile(r"[A-Za-z_]\w*", re.ASCII)
_NUMBER = re.compile(r"(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?", re.ASCII)
_TEXT = re.compile(r'"((?:[^"\\\n]|\\.)*)"')
_TOPIC = re.compile(r"[/~]?[A-Za-z]\w*(?:/[A-Za-z]\w*)*", re.ASCII)
_SHOWN = re.compile(r"\S+")


@dataclass(slots=True)
class Scanner:
    """A text of a file, and `at` which character reading is."""

    text: str
    file: str
    at: int = 0
    end: int = 0
    """Where the last piece ended."""

    def __post_init__(self) -> None:
        """Go to the first piece."""
        self._skip()

    def _skip(self) -> None:
        match = _BETWEEN.match(self.text, self.at)
        self.at = match.end() if match else self.at

    @property
    def over(self) -> bool:
        """Whether nothing is left."""
        return self.at >= len(self.text)

    def take(self, pattern: re.Pattern[str]) -> str | None:
        """Read what matches a pattern here, None where nothing does."""
        match = pattern.match(self.text, self.at)
        if match is None or not match[0]:
            return None
        self.at = self.end = match.end()
        self._skip()
        return match[0]

    def word(self, *words: str) -> str | None:
        """Read one of some words, None where none of them stands here."""
        match = _WORD.match(self.text, self.at)
        return self.take(_WORD) if match and match[0] in words else None

    def sign(self, *signs: str) -> str | None:
        """Read one of some signs, the first that stands here; None where none does."""
        for sign in signs:
            if self.text.startswith(sign, self.at):
                return self.take(_literal(sign))
        return None

    def name(self) -> str | None:
        """Read a word, whichever it is."""
        return self.take(_WORD)

    def peek(self) -> str:
        """The word that stands here, or nothing."""
        match = _WORD.match(self.text, self.at)
        return match[0] if match else ""

    def number(self) -> str | None:
        """Read a number."""
        return self.take(_NUMBER)

    def string(self) -> str | None:
        """Read a text in double quotes, and give it without them."""
        found = self.take(_TEXT)
        return None if found is None else re.sub(r"\\(.)", r"\1", found[1:-1])

    def topic(self) -> str | None:
        """Read the name of a topic."""
        return self.take(_TOPIC)

    def place(self, at: int) -> tuple[int, int]:
        """The line and column of a character."""
        return self.text.count("\n", 0, at) + 1, at - self.text.rfind("\n", 0, at)

    def refuse(self, expected: str, at: int | None = None) -> NoReturn:
        """Raise what is expected at a place, here by default."""
        at = self.at if at is None else at
        line, column = self.place(at)
        shown = _SHOWN.match(self.text, at)
        found = f"`{shown[0][:40]}`" if shown else "the end"
        raise HplError(f"{self.file}:{line}:{column}: {expected}, and not {found}")


@cache
def _literal(sign: str) -> re.Pattern[str]:
    return re.compile(re.escape(sign))
