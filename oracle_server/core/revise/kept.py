"""The rows that a late event may still change, and how the judge stood after each."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator

import msgspec

from oracle_server.core.derived.journal import Undo
from oracle_server.core.episode import Following
from oracle_server.core.events import Step
from oracle_server.core.judging.holding import Version
from oracle_server.core.kinds import TICK
from oracle_server.core.revise.finality import Stand
from oracle_server.core.verdicts import Judged

MOST = 10_000
"""Rows that are kept; where there are more, the horizon is shorter."""


def key_of(time: int, *, tick: bool = False) -> int:
    """Where something at a time (ns) stands among the rows: a deadline behind all steps at its time."""
    return 2 * time + tick


class Point(msgspec.Struct, gc=False):
    """How a judge stood; times in nanoseconds. `before` is the time of the step before the last one."""

    present: int
    before: int
    ticked: int
    outdated: bool
    steps: int
    held: Version
    properties: tuple[Stand, ...]
    following: Following


class Kept(Point, gc=False):
    """A row as it stands, and how the judge stood after it: in one object, as a horizon has many.

    `key` is where it stands, as by `key_of`, and never less than that of the row before; `level`: deadlines up to then
    (ns) were judged before it. `preceding` is the position of the row said before it. `undone`: it was denied, and
    taken back. `noted` takes back what it changed of derived signals.
    """

    judged: Judged
    key: int
    level: int
    position: int
    preceding: int
    undone: bool = False
    noted: tuple[Undo, ...] = ()

    @property
    def is_tick(self) -> bool:
        """Whether it is a deadline."""
        return self.judged.step.event.stream.kind == TICK

    @property
    def numbers(self) -> Iterator[int]:
        """Those of its verdicts."""
        return iter([verdict.n for verdict in self.judged.verdicts])

    @property
    def step(self) -> Step:
        """Its step."""
        return self.judged.step


class Keeping:
    """The kept rows, in the order in which they stand."""

    def __init__(self, horizon: int, begin: Point, most: int = MOST, floor: int = 0) -> None:
        """Keep rows for a `horizon` (ns) behind the key `floor`, where the judge stands as at the beginning."""
        self.rows: deque[Kept] = deque()
        self.base = begin
        """How the judge stood before the first of them."""
        self.floor = floor
        """The key of the last row that is not kept any more: what is older can't be put in its place."""
        self.crowded = False
        """Whether the rows of a horizon were more than are kept."""
        self.placed: list[int] = []
        """The positions of the late events that are not kept any more, and that may have a greater one than kept rows.
        """
        self.last = begin
        """How the judge stands after the last row."""
        self.key = floor
        """The key of the last row."""
        self._horizon, self._most = horizon, most

    def __iter__(self) -> Iterator[Kept]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def add(self, row: Kept, newest: int) -> None:
        """Keep a row, and let go of the first where they are too many; `newest` is the time of the newest step (ns)."""
        rows = self.rows
        rows.append(row)
        self.last, self.key = row, row.key
        if len(rows) > self._most:
            self.crowded = self.crowded or rows[0].key >= key_of(newest - self._horizon)
            self._let_go()
            while rows and rows[0].is_tick and rows[0].key == self.floor:  # those of one time are judged again together
                self._let_go()

    def forget(self, newest: int) -> None:
        """Let go of the rows that are more than a horizon older than the newest step (ns)."""
        rows, limit = self.rows, key_of(newest - self._horizon)
        while rows and rows[0].key < limit:
            self._let_go()

    def close(self, until: int) -> None:
        """Let go of all rows: nothing up to a time (ns) can be put in its place any more."""
        while self.rows:
            self._let_go()
        self.floor = self.key = max(self.floor, key_of(until, tick=True))

    def _let_go(self) -> None:
        gone = self.rows.popleft()
        self.base, self.floor = gone, gone.key
        if gone.judged.place is not None:
            self.placed.append(gone.position)

    def after(self, time: int) -> list[Kept]:
        """Take away the rows behind a step at a time (ns); the last one first."""
        taken, key = [], key_of(time)
        while self.rows and self.rows[-1].key > key:
            taken.append(self.rows.pop())
        self.last, self.key = (self.rows[-1], self.rows[-1].key) if self.rows else (self.base, self.floor)
        return taken
