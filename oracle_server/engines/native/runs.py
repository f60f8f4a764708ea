"""The runs of steps at which the right side of a `since` held, as far as they still count, and their changes undone."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from oracle_server.engines.native.timeline import Journal

Times = deque[int] | list[int]


class Runs:
    """What is known at one key.

    `left` and `right` are the sides' values at the last step; `starts` and `ends` the times at which runs of the right
    side began and ended, the last one not yet where there is a start more; `value` the operator's value.
    """

    __slots__ = ("ends", "left", "right", "starts", "value")

    def __init__(self) -> None:
        self.left, self.right, self.value = True, False, False
        self.starts: Times = []
        self.ends: Times = []

    def copy(self) -> Runs:
        """The same, to go a way of its own."""
        other = Runs.__new__(Runs)
        other.left, other.right, other.value = self.left, self.right, self.value
        other.starts, other.ends = self.starts.copy(), self.ends.copy()
        return other

    def data(self) -> Any:
        """As plain data."""
        return [self.left, self.right, self.value, list(self.starts), list(self.ends)]

    @staticmethod
    def of(data: Any, queue: Callable[[Iterable[int]], Times]) -> Runs:
        """What `data` gave."""
        runs = Runs()
        runs.left, runs.right, runs.value = data[:3]
        runs.starts, runs.ends = queue(data[3]), queue(data[4])
        return runs

    def clear(self, journal: Journal | None) -> None:
        """Forget all runs."""
        if not self.starts:
            return
        if journal is None:
            self.starts.clear()
            self.ends.clear()
            return
        journal.append(partial(self._put, self.starts, self.ends))
        self.starts, self.ends = type(self.starts)(), type(self.ends)()

    def begin(self, time: int, journal: Journal | None) -> None:
        """Note that a run began."""
        self.starts.append(time)
        if journal is not None:
            journal.append(self.starts.pop)

    def end(self, time: int, journal: Journal | None) -> None:
        """Note that the last run ended."""
        self.ends.append(time)
        if journal is not None:
            journal.append(self.ends.pop)

    def forget(self, journal: Journal | None) -> None:
        """Forget the first run, which has ended."""
        if journal is not None:
            journal.append(partial(self.starts.insert, 0, self.starts[0]))
            journal.append(partial(self.ends.insert, 0, self.ends[0]))
        del self.starts[0]
        del self.ends[0]

    @property
    def values(self) -> tuple[bool, bool, bool]:
        """The values of the sides, the left one first, and its own."""
        return self.left, self.right, self.value

    def put(self, values: tuple[bool, bool, bool]) -> None:
        """Take what `values` gave."""
        self.left, self.right, self.value = values

    def _put(self, starts: Times, ends: Times) -> None:
        self.starts, self.ends = starts, ends
