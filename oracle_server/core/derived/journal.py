"""The journal of what changes: what is noted there takes it back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import msgspec

Undo = Callable[[], object]


class Was(msgspec.Struct, frozen=True, gc=False):
    """Gives an attribute the value that it had.

    A third of what a closure takes: where late events are put in their places, those of a horizon's steps are kept.
    """

    owner: object
    name: str
    value: Any

    def __call__(self) -> None:
        """Take the change back."""
        setattr(self.owner, self.name, self.value)


class Journal:
    """What takes back each change since it was begun; `entries` is None where none is kept."""

    __slots__ = ("_open", "entries")

    def __init__(self) -> None:
        self.entries: list[Undo] | None = None
        self._open: list[list[Undo]] = []

    def mark(self) -> None:
        """Note all changes from now on, until `back` or `keep`; marks can be nested."""
        self._open.append([])
        self.entries = self._open[-1]

    def back(self) -> None:
        """Take back all changes since the last mark."""
        take_back(self._close())

    def keep(self) -> None:
        """Keep the changes since the last mark."""
        noted = self._close()
        if self.entries is not None:
            self.entries += noted

    def record(self) -> None:
        """From now on note all changes, also where no mark is open, for `noted` to tell."""
        self._open = [[]]
        self.entries = self._open[0]

    def noted(self) -> tuple[Undo, ...]:
        """What takes back the changes since `record`, or since this was called last; no mark is open."""
        (base,) = self._open
        found = tuple(base)
        base.clear()
        return found

    def _close(self) -> list[Undo]:
        noted = self._open.pop()
        self.entries = self._open[-1] if self._open else None
        return noted


def take_back(noted: Sequence[Undo]) -> None:
    """Take back changes, the last one first."""
    for undo in reversed(noted):
        undo()
