"""Blocks in the database: made in the transaction of the rows that complete them, and anew where rows are revised.

Those of level 0 are made in their sequence, without gaps, those of further levels once all below are there. Rows that
an older version has written are caught up with, some at a time.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Any

import structlog

from oracle_server.core.events import Order
from oracle_server.history.blocks import (
    BEFORE,
    FANOUT,
    LEVELS,
    SIZE,
    Block,
    merged,
    of_columns,
    of_rows,
    positions,
)
from oracle_server.history.sql.batch import REFUSED, Work
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.rows import Row
from oracle_server.history.sql.schema import STEP_COLUMNS
from oracle_server.history.sql.statements import upsert
from oracle_server.history.sql.timeline import BLOCKS, COLUMNS, EXTENT, ROWS

CATCH_UP = 1_024
"""Rows without blocks that are caught up with at once; with more a session waits for those who catch up."""
_COLUMNS = ("session", "level", "block", "since", "until", "worst", "degraded", "data")
_INSERT = upsert("blocks", _COLUMNS, _COLUMNS[:3])
_FORGET = "DELETE FROM blocks WHERE session = ? AND level = ? AND block < ?"
_DECIDES = "SELECT decides FROM sessions WHERE number = ?"

_STEPS = f"SELECT {','.join(STEP_COLUMNS)} FROM steps WHERE session = ? AND position BETWEEN ? AND ? ORDER BY position"  # noqa: S608
_POSITION = STEP_COLUMNS.index("position")
_picked = itemgetter(*(STEP_COLUMNS.index(name) for name in COLUMNS))

log = structlog.get_logger()


def forgetting(session: int, before: int) -> list[tuple[str, tuple[int, int, int]]]:
    """Statements that delete the blocks which have steps before a position, with their values."""
    return [(_FORGET, (session, level, -(-(before - 1) // positions(level)))) for level in range(LEVELS)]


def catching(session: int, done: Callable[[], object]) -> Work:
    """Has some of the blocks made that a session lacks: the work of no steps."""
    return Work(session, "steps", (), done, always=True)


@dataclass(slots=True)
class _Tail:
    """What is behind a session's last blocks: rows, and by level blocks that have none above them yet.

    `next` is the number of the next block of level 0, and `since` the time before it. `behind`: not all rows are there.
    """

    decides: Order
    next: int
    since: int
    rows: list[Row]
    below: list[dict[int, Block]]
    behind: bool


class BlockWriter:
    """Follows what is written. To be used in the writer's thread, within its transactions."""

    def __init__(self) -> None:
        self._tails: dict[int, _Tail] = {}
        self._given_up: set[int] = set()

    def forget(self) -> None:
        """What was followed last is not committed: read what is there, the next time."""
        self._tails.clear()

    def follow(self, database: Database, work: Sequence[Work]) -> None:
        """Make the blocks that written work completes, or touches. Raises what SQLite raises of disks that fail."""
        added: defaultdict[int, list[Row]] = defaultdict(list)
        touched: defaultdict[int, set[int]] = defaultdict(set)
        wanted = {one.session for one in work if one.what == "steps" and one.always}
        for one in work:
            if one.what == "steps":
                added[one.session] += one.values
                if one.then is not None:
                    touched[one.session].update(one.then.positions)
            elif one.always:  # it is closed, or some of its steps are deleted
                self._tails.pop(one.session, None)
        for session, rows in added.items():
            if session not in self._given_up:
                try:
                    self._follow_one(database, session, rows, touched[session], anyway=session in wanted)
                except REFUSED as error:
                    self._given_up.add(session)
                    self._tails.pop(session, None)
                    reason = str(error) or type(error).__name__
                    log.error("a session's timeline can't be kept", session=session, reason=reason)

    def _follow_one(
        self, database: Database, session: int, rows: list[Row], touched: set[int], *, anyway: bool
    ) -> None:
        if touched or session not in self._tails:
            self._load(database, session, len(rows), anyway=anyway or bool(touched))
        else:
            self._tails[session].rows += rows
        tail = self._tails.get(session)
        if tail is None:
            return
        if len(tail.rows) >= SIZE:
            database.executemany(_INSERT, _extend(session, tail))
        if touched:
            _make_anew(database, session, tail, {(position - 1) // SIZE for position in touched})
        if touched or tail.behind:  # what waits for blocks above it is another, or rows are missing
            self._tails.pop(session)

    def _load(self, database: Database, session: int, added: int, *, anyway: bool) -> None:
        """Read a session's tail, unless it is too far behind to be caught up with now, and that is not wanted."""
        self._tails.pop(session, None)
        found = database.execute(_DECIDES, (session,)).fetchone()
        if found is None:
            return
        first, last, _, block = database.execute(EXTENT, (session,)).fetchone()
        following = max(-(-(first - 1) // SIZE), 0 if block is None else block + 1)
        most = CATCH_UP + added
        behind = last - following * SIZE > most
        if behind and not anyway:
            return
        tail = self._tails[session] = _Tail(found[0], following, BEFORE, [], [], behind)
        for level in range(LEVELS - 1):
            end = following // FANOUT**level
            read = database.execute(BLOCKS, (session, level, end // FANOUT * FANOUT, end - 1))
            tail.below.append({number: Block(*rest) for number, *rest in read})
        if block is not None:
            ((_, _, tail.since, *_),) = database.execute(BLOCKS, (session, 0, block, block))
        tail.rows = database.execute(_STEPS, (session, following * SIZE + 1, following * SIZE + most)).fetchall()


def _extend(session: int, tail: _Tail) -> list[tuple[Any, ...]]:
    """The rows of the blocks that a tail completes, which it then has no more."""
    made: list[tuple[Any, ...]] = []
    count = len(tail.rows) // SIZE
    for start in range(0, count * SIZE, SIZE):
        columns = [*zip(*tail.rows[start : start + SIZE], strict=True)]
        if columns[_POSITION][-1] != (tail.next + 1) * SIZE:
            raise ValueError("its positions have gaps")
        block = of_columns(_picked(columns), tail.since, tail.decides)
        tail.next, tail.since = tail.next + 1, block.until
        _rise(session, tail, tail.next - 1, block, made)
    del tail.rows[: count * SIZE]
    return made


def _rise(session: int, tail: _Tail, number: int, block: Block, made: list[tuple[Any, ...]]) -> None:
    """Add a block, and those above it that are complete by it."""
    for level in range(LEVELS):
        made.append(_row(session, level, number, block))
        if level == LEVELS - 1:
            return
        below = tail.below[level]
        below[number] = Block(*made[-1][3:])  # as text: it takes less
        if number % FANOUT < FANOUT - 1:
            return
        blocks = [*below.values()]
        below.clear()
        if len(blocks) < FANOUT:  # some were deleted
            return
        number, block = number // FANOUT, merged(blocks)


def _make_anew(database: Database, session: int, tail: _Tail, touched: set[int]) -> None:
    """Make blocks of level 0 anew, and those above them; as far as they are there."""
    made = []
    for number in sorted(touched):
        known = database.execute(BLOCKS, (session, 0, number, number)).fetchone()
        if known is not None:
            rows = database.execute(ROWS, (session, number * SIZE + 1, (number + 1) * SIZE)).fetchall()
            made.append(_row(session, 0, number, of_rows(rows, known[1], tail.decides)))
    database.executemany(_INSERT, made)
    for level in range(1, LEVELS):
        touched, made = {number // FANOUT for number in touched}, []
        for number in sorted(touched):
            first = number * FANOUT
            below = database.execute(BLOCKS, (session, level - 1, first, first + FANOUT - 1)).fetchall()
            known = database.execute(BLOCKS, (session, level, number, number)).fetchone()
            if known is not None:
                made.append(_row(session, level, number, merged([Block(*row[1:]) for row in below])))
        database.executemany(_INSERT, made)


def _row(session: int, level: int, number: int, block: Block) -> tuple[Any, ...]:
    return session, level, number, block.since, block.until, block.worst, block.degraded, block.text
