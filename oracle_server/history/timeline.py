"""What went on by time: a window in buckets, answered from blocks, and from rows where these are too wide.

What is counted in a window is what its rows count. Within it, what is told of a block that lies in two buckets is in
the first of them: nothing is more than one bucket off.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Protocol

from oracle_server.core.events import Order
from oracle_server.history.blocks import BEFORE, FANOUT, LEVELS, SIZE, Block, BlockRow, of_rows, timed
from oracle_server.history.columns import PARTS, Columns, Part, grid, grid_of

NOTHING_NEW = b"{}"
"""The JSON of an answer where no row has come since a position."""
MOST_NEWS = 20_000
"""Rows that may have come since a position, for what they change to be told."""


@dataclass(frozen=True, slots=True)
class Question:
    """A window (ns, both ends included and in order; None is the session's own) in so many buckets at the most.

    `signals` are written `STREAM:SIGNAL`, with the stream as `str(StreamKey)`. With `after` the window begins where
    something is told otherwise since that position; `width` (ns) is that of its buckets then.
    """

    since: int | None = None
    until: int | None = None
    buckets: int = 1_000
    parts: frozenset[Part] = frozenset(PARTS)
    signals: tuple[str, ...] = ()
    after: int | None = None
    width: int = 0


class Source(Protocol):
    """What is kept of a session: positions `first` to `last`, and the blocks of level 0 from `begin` to before `end`.

    Of further levels there are those above these. Where it is `simulated` it is not known how long its events waited.
    """

    decides: Order
    simulated: bool
    first: int
    last: int
    begin: int
    end: int

    def blocks(self, level: int, begin: int, end: int) -> list[Block]:
        """The blocks of a level from one number to before another."""
        ...

    def rows(self, first: int, last: int) -> list[BlockRow]:
        """The rows from one position to another."""
        ...

    def revised(self, after: int) -> int | None:
        """The first position of which rows behind another one say that something else stands."""
        ...


def answer(source: Source, question: Question, properties: Sequence[str]) -> dict[str, Any]:
    """What a session tells of a window, as plain data.

    With `after` nothing where no row has come since, and `again` where too much has, or where that is a position of
    another session that had the name: all is to be asked for anew.
    """
    if question.after is None:
        return _Reading(source, question, properties).document
    if question.after == source.last:
        return {}
    if 0 <= source.last - question.after <= MOST_NEWS:
        reading = _Reading(source, question, properties)
        if reading.fits:
            return reading.document
    return {"position": source.last, "again": True}


class _Reading:
    """One question, while it is answered."""

    def __init__(self, source: Source, question: Question, properties: Sequence[str]) -> None:
        self._source, self._signals = source, bool(question.signals)
        self._there = source.end > source.begin
        head, tail = self._loose()
        known = [time for rows in (head, tail) for time, _ in (*rows[:1], *rows[-1:])]
        if self._there:
            numbers = range(source.begin, source.end)
            begun = bisect_left(numbers, BEFORE + 1, key=lambda n: self._block(n).until)
            known += [self._block(n).since for n in numbers[begun : begun + 1]]
            known += [self._block(n).until for n in numbers[max(begun, len(numbers) - 1) :]]
        first, last = min(known, default=0), max(known, default=0)
        until = max(question.since or 0, last) if question.until is None else question.until
        since = min(first, until) if question.since is None else question.since
        if question.after is None:
            self._grid = grid(since, until, question.buckets)
        else:
            self._grid = grid_of(question.width, self._changed(question.after, (head, tail), last), last)
        self.fits = self._grid.buckets <= question.buckets
        if not self.fits:
            return
        self._columns = Columns(self._grid, properties, question.parts, question.signals)
        self._add(head)
        if self._there:
            self._add_blocks()
        self._add(tail)
        ends = {"first": first if known else None, "last": last if known else None}
        self.document = {"position": source.last, **ends, **self._columns.document()}
        if source.simulated and "hold" in self.document:
            self.document["hold"] = None

    def _loose(self) -> tuple[list[tuple[int, BlockRow]], list[tuple[int, BlockRow]]]:
        """The rows before the first block of level 0, and those behind the last one, with their times."""
        source = self._source
        if not self._there:
            return [], timed(source.rows(source.first, source.last), BEFORE, source.decides)
        head = timed(source.rows(source.first, source.begin * SIZE), BEFORE, source.decides)
        tail = source.rows(source.end * SIZE + 1, source.last)
        return head, timed(tail, self._block(source.end - 1).until, source.decides)

    def _changed(self, after: int, loose: Sequence[list[tuple[int, BlockRow]]], last: int) -> int:
        """The time from which on something is told otherwise since a position, or one a little earlier."""
        source = self._source
        revised = source.revised(after)
        position = max(source.first, after + 1 if revised is None else min(revised, after + 1))
        number = (position - 1) // SIZE
        if source.begin <= number < source.end:
            block = self._block(number)
            rows = timed(source.rows(number * SIZE + 1, (number + 1) * SIZE), block.since, source.decides)
            return next((time for time, row in rows if row[0] >= position), block.until)
        return next((time for rows in loose for time, row in rows if row[0] >= position), last)

    def _block(self, number: int) -> Block:
        (found,) = self._source.blocks(0, number, number + 1)
        return found

    def _add_blocks(self) -> None:
        """Add the blocks that have steps in the window, those at its edges row by row."""
        numbers = range(self._source.begin, self._source.end)
        begin = numbers.start + bisect_left(numbers, self._grid.since, key=lambda n: self._block(n).until)
        end = numbers.start + bisect_left(numbers, self._grid.until, key=lambda n: self._block(n).since)
        if begin >= end:
            return
        level = -1
        while level < LEVELS - 1 and (end - begin) // FANOUT ** (level + 1) >= self._grid.buckets:
            level += 1
        if level < 0:
            self._add_rows(begin, end)
            return
        if self._block(begin).since < self._grid.since:
            self._add_rows(begin, begin + 1)
            begin += 1
        if begin < end and self._block(end - 1).until >= self._grid.until:
            end -= 1
            self._add_rows(end, end + 1)
        self._cover(begin, end, level)

    def _cover(self, begin: int, end: int, most: int) -> None:
        """Add blocks of level 0 by as few blocks as there are, of a level at most."""
        level = 0
        while level < most and begin < end:
            up, down = -(-begin // FANOUT) * FANOUT, end // FANOUT * FANOUT
            if up >= down:
                break
            self._add_level(level, begin, up)
            self._add_level(level, down, end)
            begin, end, level = up // FANOUT, down // FANOUT, level + 1
        self._add_level(level, begin, end)

    def _add_level(self, level: int, begin: int, end: int) -> None:
        """Add blocks of a level; those that are wider than a bucket by what they are made of."""
        if begin >= end:
            return
        for number, block in enumerate(self._source.blocks(level, begin, end), begin):
            if block.until - block.since <= self._grid.width:
                self._columns.add(block)
            elif level:
                self._add_level(level - 1, number * FANOUT, (number + 1) * FANOUT)
            else:
                self._add_rows(number, number + 1)

    def _add_rows(self, begin: int, end: int) -> None:
        """Add the rows of blocks of level 0 that are in the window."""
        rows = self._source.rows(begin * SIZE + 1, end * SIZE)
        self._add(timed(rows, self._block(begin).since, self._source.decides))

    def _add(self, rows: list[tuple[int, BlockRow]]) -> None:
        """Add rows in their sequence, as far as they are in the window."""
        own = [row for row in rows if self._grid.since <= row[0] < self._grid.until]
        for _, found in groupby(own, lambda row: (row[0] - self._grid.since) // self._grid.width):
            bucket = [*found]
            block = of_rows([row for _, row in bucket], bucket[0][0], self._source.decides, signals=self._signals)
            self._columns.add(block)
