"""Timelines of every backend: while it is written, by a process that may end, of what older versions wrote."""

from __future__ import annotations

import asyncio
import random
import sqlite3
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from oracle_server.core.errors import HistoryError, UnpreparedError
from oracle_server.core.revisions import Revision
from oracle_server.core.verdicts import Outcome
from oracle_server.history.port import History
from oracle_server.history.records import MonitorRecord, StoredStep, stored_revision
from oracle_server.history.sql import asking, timeline
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.timeline import Question
from oracle_server.process.worker import Worker
from tests.history.blocked import SIGNALS, check, some
from tests.history.making import add, opened, revision
from tests.history.test_port import collected
from tests.history.test_standing import stands

ALL = Question(signals=SIGNALS)


async def told(history: History, question: Question = ALL) -> dict[str, object]:
    found: dict[str, object] = msgspec.json.decode(await history.timeline(opened(), question))
    return found


async def held_against_rows(history: History, question: Question = ALL) -> None:
    check(await told(history, question), await collected(history.steps(1, 0)), "publication")


async def begun(folder: Path) -> SqliteHistory:
    history = SqliteHistory(folder)
    history.start(asyncio.get_running_loop())
    return history


def steps(count: int, first: int = 1) -> list[StoredStep]:
    return some(random.Random(count), first, count, first * 10**6)


@pytest.mark.parametrize("buckets", [1, 20, 2000])
async def test_a_history_tells_what_its_rows_come_to(history: History, buckets: int) -> None:
    history.open_session(opened())
    assert (await told(history))["position"] == 0
    await add(history, *steps(700))
    await held_against_rows(history, Question(buckets=buckets, signals=SIGNALS))


async def test_what_is_revised_is_told_as_it_stands(history: History) -> None:
    history.open_session(opened())
    made = steps(100)
    late: Revision = revision(101, None, None, standing={7: stands(Outcome.FALSE, Outcome.FALSE)})
    history.append(1, [*made, stored_revision(101, late)], lambda: None, [late])
    await history.flush()
    await held_against_rows(history)
    assert "F" in str((await told(history))["lanes"])


async def test_what_is_deleted_is_not_told(history: History) -> None:
    history.open_session(opened())
    await add(history, *steps(600))
    await history.forget_steps(1, 300)
    await add(history, *steps(100, 601))
    assert sum((await told(history))["steps"]) == 401  # type: ignore[call-overload]
    await history.forget_session(1)
    assert (await told(history))["position"] == 0


async def test_how_long_asks_waited_is_not_known_in_simulated_time(history: History) -> None:
    history.open_session(opened())
    await add(history, *steps(50))
    assert (await told(history))["hold"] is not None
    history.set_monitor(1, MonitorRecord("m", "i", (), attached=True, clock="sim"))
    await history.flush()
    assert (await told(history))["hold"] is None


async def test_a_reader_that_was_killed_is_started_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(asking, "Worker", Worker)  # one of its own
    history = await begun(tmp_path)
    history.open_session(opened())
    await add(history, *steps(50))
    await held_against_rows(history)
    reader = history._asking.worker.process
    assert reader is not None
    reader.kill()
    reader.wait()
    await held_against_rows(history)
    await asyncio.to_thread(history.close)
    assert history._asking.worker.process is None


async def test_a_database_that_cannot_be_read_is_told_of(tmp_path: Path) -> None:
    history = await begun(tmp_path)
    with closing(sqlite3.connect(history.path)) as database:
        database.execute("DROP TABLE blocks")
    with pytest.raises(HistoryError, match=r"the history can't be read: no such table: blocks"):
        await told(history)
    await asyncio.to_thread(history.close)


async def test_what_an_older_version_wrote_is_told_once_it_is_made(tmp_path: Path) -> None:
    history = await begun(tmp_path)
    history.open_session(opened())
    await add(history, *steps(timeline.MOST_ROWS + 100))
    await asyncio.to_thread(history.close)
    with closing(sqlite3.connect(history.path)) as database:
        wanted = database.execute("SELECT * FROM blocks").fetchall()
        database.execute("DELETE FROM blocks")
        database.commit()
    history = await begun(tmp_path)
    with pytest.raises(UnpreparedError, match="'s' was written by an older version: 0 % of its timeline"):
        await told(history)
    making = asyncio.create_task(history.catch_up())
    await add(history, *steps(64, timeline.MOST_ROWS + 101))
    await making
    await add(history, *steps(64, timeline.MOST_ROWS + 165))
    with closing(sqlite3.connect(history.path)) as database:
        found = set(database.execute("SELECT * FROM blocks").fetchall())
        assert found >= set(wanted)
        (last,) = database.execute("SELECT max(block) FROM blocks WHERE level = 0").fetchone()
    assert last == (timeline.MOST_ROWS + 228) // 32 - 1
    await asyncio.to_thread(history.close)


async def test_what_an_older_version_wrote_is_made_once_the_database_can_be_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = await begun(tmp_path)
    history.open_session(opened())
    await add(history, *steps(64))
    await asyncio.to_thread(history.close)
    history = await begun(tmp_path)
    rest = asyncio.sleep
    with closing(sqlite3.connect(history.path, isolation_level=None)) as database:
        database.execute("DELETE FROM blocks")
        database.execute("ALTER TABLE blocks RENAME TO away")

        async def back(_: float) -> None:
            monkeypatch.setattr(asyncio, "sleep", rest)
            database.execute("ALTER TABLE away RENAME TO blocks")

        monkeypatch.setattr(asyncio, "sleep", back)
        await history.catch_up()
        assert database.execute("SELECT count(*) FROM blocks WHERE level = 0").fetchone() == (2,)
    await asyncio.to_thread(history.close)


async def test_a_restart_goes_on_with_its_blocks(tmp_path: Path) -> None:
    first = 1
    for count in (5, 100, 31, 1, 700):
        history = await begun(tmp_path)
        if first == 1:
            history.open_session(opened())
        await add(history, *steps(count, first))
        await held_against_rows(history)
        first += count
        await asyncio.to_thread(history.close)
    with closing(sqlite3.connect(history.path)) as database:
        counts = dict(database.execute("SELECT level, count(*) FROM blocks GROUP BY level"))
    assert counts == {0: 837 // 32, 1: 837 // 256}
