"""Which key had a sample when, in the order of time."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from functools import partial

from oracle_server.core.derived.journal import Journal, Was
from oracle_server.core.formula.tree import Scalar

Key = Scalar | tuple[bool] | tuple[Scalar | tuple[bool], ...]
"""A value as a key, since Python takes 1 and True for the same; of several values a tuple of their keys."""
_LEAST = 1024


class Queue:
    """Positions that never go down, each with a key."""

    __slots__ = ("_head", "_journal", "_keys", "_most", "_places", "_unadd")

    def __init__(self, journal: Journal) -> None:
        self._journal = journal
        self._places: list[int] = []
        self._keys: list[Key] = []
        self._head = 0
        self._most = 2 * _LEAST
        self._unadd = self._pop
        """Takes the last one back; each step notes the same."""

    def add(self, at: int, key: Key) -> None:
        """Add a key."""
        self._places.append(at)
        self._keys.append(key)
        if self._journal.entries is not None:
            self._journal.entries.append(self._unadd)

    @property
    def is_long(self) -> bool:
        """Whether it has grown to twice what it was when it was filled."""
        return len(self._places) > self._most

    @property
    def is_spent(self) -> bool:
        """Whether all of it was passed by."""
        return self._head == len(self._places)

    def trim(self) -> bool:
        """Let go of what was passed by, where that is half of it; returns whether it was."""
        if 2 * self._head < len(self._places):
            return False
        if self._journal.entries is not None:
            self._journal.entries.append(partial(self._restore, self._places, self._keys, self._head))
        self._places, self._keys, self._head = self._places[self._head :], self._keys[self._head :], 0
        self._most = 2 * max(_LEAST, len(self._places))
        return True

    def fill(self, pairs: list[tuple[int, Key]]) -> None:
        """Begin anew with these pairs, in order."""
        if self._journal.entries is not None:
            self._journal.entries.append(partial(self._restore, self._places, self._keys, self._head))
        self._places, self._keys = [at for at, _ in pairs], [key for _, key in pairs]
        self._head = 0
        self._most = 2 * max(_LEAST, len(pairs))

    def pass_by(self, limit: int) -> list[Key]:
        """Let go of the positions up to a limit; returns their keys."""
        places, head = self._places, self._head
        if head == len(places) or places[head] > limit:
            return []
        end = bisect_right(places, limit, head)
        if self._journal.entries is not None:
            self._journal.entries.append(Was(self, "_head", head))
        self._head = end
        return self._keys[head:end]

    def next_after(self, position: int) -> int | None:
        """The first position later than one, None where there is none."""
        index = bisect_right(self._places, position, self._head)
        return self._places[index] if index < len(self._places) else None

    def at(self, position: int) -> Iterator[Key]:
        """The keys at a position."""
        begin = bisect_left(self._places, position, self._head)
        return iter(self._keys[begin : bisect_right(self._places, position, begin)])

    def _restore(self, places: list[int], keys: list[Key], head: int) -> None:
        self._places, self._keys, self._head = places, keys, head

    def _pop(self) -> None:
        self._places.pop()
        self._keys.pop()
