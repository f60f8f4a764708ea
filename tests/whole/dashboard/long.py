"""A session of thirty properties and a million steps in a history, made from some that are written and then copied."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from oracle_server.history.blocks import FANOUT, SIZE
from oracle_server.history.sql.batch import Work, write
from oracle_server.history.sql.blocks import BlockWriter
from oracle_server.history.sql.rows import Row
from tests.whole.client import BASE

STEPS = 1_000_000
APART = 10**6
"""ns from one step to the next: 1,000 a second."""
PROPERTIES = 30
FAILS = 26
"""The place of the property that fails."""
EVERY, LONG = 4096, 400
"""Steps from one episode to the next, and how many of them it has."""
_MODEL = SIZE * FANOUT**4
"""Steps that are written; the others are copied, as are their blocks but for those of more steps."""
_TOGETHER = 8192
_WHY = f'{{"{FAILS}":{{"text":"never_27 does not hold","formula":"not {{v: 27}}","event":{{"signals":{{"v":27}}}}}}}}'


def rows(session: int) -> Iterator[Row]:
    """The rows that are written, of the table `steps`."""
    for position in range(1, _MODEL + 1):
        at = BASE + position * APART
        wrong = position % EVERY < LONG
        outcomes = "t" * FAILS + ("f" if wrong else "t") + "t" * (PROPERTIES - FAILS - 1)
        yield (
            session, position, "publication", position, "/a", "topic", "m1", position, 0, at, at + 10**6, at + 10**6, 0,
            0, 0, 0, "m1", None, 0, None, "[]", None, None, f'{{"v":{27 if wrong else position % 16}}}', "[]",
            outcomes, "0" * PROPERTIES, _WHY if position % EVERY == 0 else None, None, "frontier", *(None,) * 9,
        )  # fmt: skip


def fill(path: Path, session: int) -> None:
    """Give a session of a history, by its number, all of its steps, blocks and episodes."""
    with closing(sqlite3.connect(path, isolation_level=None)) as database:
        database.execute("PRAGMA synchronous = OFF")
        database.execute("BEGIN IMMEDIATE")
        blocks = BlockWriter()
        made = rows(session)
        while batch := [row for _, row in zip(range(_TOGETHER), made, strict=False)]:
            work = [Work(session, "steps", batch)]
            write(database, work)
            blocks.follow(database, work)
        _copy(database, session)
        known = 'replace(state, \'"outcome":"unknown"\', \'"outcome":"currently_true"\')'
        database.execute(f"UPDATE sessions SET state = {known} WHERE number = ?", (session,))
        for began in range(EVERY, STEPS - LONG, EVERY):
            database.execute(
                "INSERT INTO episodes VALUES (?, 'never_27', ?, 'publication', ?, ?, ?, 0, 0, ?, NULL, 'it is 27')",
                (session, (began - 1) * PROPERTIES + FAILS + 1, BASE + began * APART,
                 (began + LONG - 2) * PROPERTIES + FAILS + 1, BASE + (began + LONG - 1) * APART, LONG),
            )  # fmt: skip
        database.execute("COMMIT")


def _copy(database: sqlite3.Connection, session: int) -> None:
    """Write what has been written again and again, each time later, until all steps are there."""
    names = [row[1] for row in database.execute("PRAGMA table_info(steps)")]
    later = {
        **dict.fromkeys(("position", "number", "seq"), "?1"),
        **dict.fromkeys(("stamp", "arrived", "judged"), "?2"),
    }
    copied = ", ".join(f"{name} + {later[name]}" if name in later else name for name in names)
    for steps in range(_MODEL, STEPS, _MODEL):
        shift = (steps, steps * APART, session, min(_MODEL, STEPS - steps))
        database.execute(f"INSERT INTO steps SELECT {copied} FROM steps WHERE session = ?3 AND position <= ?4", shift)
        database.execute(
            f"INSERT INTO blocks SELECT session, level, block + ?1 / ({SIZE} << (3 * level)), since + ?2, until + ?2, "
            f"worst, degraded, data FROM blocks WHERE session = ?3 AND (block + 1) * ({SIZE} << (3 * level)) <= ?4",
            shift,
        )
