"""What is SQLite's own: what a commit survives, and what a reader keeps waiting."""

from __future__ import annotations

import asyncio
import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing, closing
from functools import partial
from pathlib import Path
from typing import Any, Literal
from unittest.mock import patch

import msgspec
import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.core.verdicts import Decision
from oracle_server.history.query import Query
from oracle_server.history.readers import THREADS, Readers, reading_for
from oracle_server.history.records import MonitorRecord, SnapshotRecord, StoredStep
from oracle_server.history.sql import matching, writer
from oracle_server.history.sql.batch import Work, write
from oracle_server.history.sql.reader import FIRST_PAGE
from oracle_server.history.sql.rows import step_row
from oracle_server.history.sql.statements import AMEND, ASKED
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.sqlite.reader import SqliteReader
from oracle_server.history.sqlite.store import Durability, SqliteStore
from tests.history.making import add, find, opened, step
from tests.whole.harness import PATIENCE, failed


@pytest.mark.parametrize(("durability", "synchronous"), [("normal", 1), ("full", 2)])
def test_the_database_waits_for_the_disk_as_is_asked(tmp_path: Path, durability: Durability, synchronous: int) -> None:
    """SQLite waits for the disk at each commit where `synchronous` is 2, and at checkpoints only where it is 1."""
    with closing(SqliteStore(tmp_path / "history.sqlite", durability)) as store:
        assert store.database.execute("PRAGMA synchronous").fetchone() == (synchronous,)
        assert store.database.execute("PRAGMA journal_mode").fetchone() == ("wal",)


@pytest.mark.parametrize("name", ["robot#7", "what?", "100%41"])
async def test_a_folder_may_have_any_name(tmp_path: Path, name: str) -> None:
    """Where it had a `#`, an empty database was made beside it, and read instead."""
    folder = tmp_path / name
    folder.mkdir()
    history = SqliteHistory(folder)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await history.flush()
    assert await history.open_sessions() == [opened()]
    await asyncio.to_thread(history.close)
    assert [*tmp_path.iterdir()] == [folder]


async def test_a_file_that_was_deleted_or_moved_takes_nothing(tmp_path: Path) -> None:
    """What was written to it went on to be acked, and nobody would ever have found it."""
    history, away = SqliteHistory(tmp_path), tmp_path / "away"
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await history.flush()
    history.path.rename(away)
    history.open_session(opened(2, "t"))
    async with asyncio.timeout(PATIENCE):
        while "was deleted, moved or replaced" not in (history.failure or ""):
            await asyncio.sleep(0.01)  # between two looks
    away.rename(history.path)
    await history.flush()
    assert history.failure is None
    assert {session.id for session in await history.open_sessions()} == {"s", "t"}
    await asyncio.to_thread(history.close)


def test_a_durability_that_there_is_not_is_told(tmp_path: Path) -> None:
    assert "ORACLE_DURABILITY" in failed("serve", "--data-dir", tmp_path, "--port", "0", ORACLE_DURABILITY="off")


class Log:
    """Takes the place of the writer's log, and tells when it has said that the history can't be written."""

    def __init__(self) -> None:
        self.told = threading.Event()

    def error(self, _: str, **__: object) -> None:
        self.told.set()


async def failing(folder: Path) -> SqliteHistory:
    """A history that can't write what it was given, whosever it is."""
    history = SqliteHistory(folder)
    history.start(asyncio.get_running_loop())
    with closing(sqlite3.connect(history.path)) as database, database:
        database.execute("ALTER TABLE steps RENAME TO lost")
    with patch.object(writer, "log", Log()) as log:
        history.append(1, [step(1)], lambda: None)
        assert await asyncio.to_thread(log.told.wait, PATIENCE)
    return history


async def test_what_can_not_be_written_for_whatever_reason_is_told(tmp_path: Path) -> None:
    history = await failing(tmp_path)
    assert history.failure is not None
    assert "no such table" in history.failure
    assert history.failure_of(1) is None, "it can be kept once the history can be written"
    await asyncio.to_thread(history.close)


async def test_nothing_is_lost_while_the_history_can_not_be_written(tmp_path: Path) -> None:
    history = await failing(tmp_path)
    with closing(sqlite3.connect(history.path)) as database, database:
        database.execute("ALTER TABLE lost RENAME TO steps")
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert history.failure is None
    assert await history.step(1, 1) == step(1)
    await asyncio.to_thread(history.close)


async def test_nothing_is_written_behind_what_could_not_be_written(tmp_path: Path) -> None:
    """Where it is closed meanwhile, a gap in the history would be left."""
    history = await failing(tmp_path)
    history.set_monitor(1, MonitorRecord("m", "i", (), attached=True, clock="wall"))
    await asyncio.to_thread(history.close)
    with closing(sqlite3.connect(history.path)) as database:
        assert database.execute("SELECT * FROM monitors").fetchall() == []


def worded(position: int, text: str) -> StoredStep:
    """A step with a text as its signal."""
    made = step(position)
    return msgspec.structs.replace(made, step=msgspec.structs.replace(made.step, signals={"v": text}))


async def test_large_steps_leave_less_room_than_small_ones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What takes long to write must not wait in such numbers that a commit takes minutes."""
    monkeypatch.setattr(writer, "MAX_PENDING", 10)
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await history.flush()
    rooms = []
    for position, length in ((1, 10), (2, 50_000)):
        history.append(1, [worded(position, "x" * length)], lambda: None)
        rooms.append(history.has_room)
    assert rooms == [True, False]
    async with asyncio.timeout(PATIENCE):
        await history.room()
    assert (history.has_room, history.pending) == (True, 0)
    await asyncio.to_thread(history.close)


def test_many_rows_are_one_statement_unless_they_are_long(tmp_path: Path) -> None:
    """SQLite copies what a statement is given while no other thread can run: 32 rows of 900 kB took 30 ms."""
    lengths: list[int] = []

    class Noted(sqlite3.Connection):
        def execute(self, statement: str, values: Any = ()) -> sqlite3.Cursor:
            lengths.append(sum(len(value) for value in values if isinstance(value, str)))
            return super().execute(statement, values)

    with closing(SqliteStore(tmp_path / "history.sqlite", "normal")):
        pass
    with closing(sqlite3.connect(tmp_path / "history.sqlite", factory=Noted)) as database:
        small = [step(p) for p in range(1, 65)]
        long = [worded(p, "x" * 100_000) for p in range(65, 80)]
        write(database, [Work(1, "steps", [*map(partial(step_row, 1), small), *map(partial(step_row, 1), long)])])
        assert max(lengths) < 200_000
        assert len(lengths) < 2 * len(long), "the small ones are few statements"
        assert database.execute("SELECT count(*), max(length(signals)) FROM steps").fetchone() == (79, 100_008)


async def test_what_can_not_be_read_is_an_error_of_the_history(tmp_path: Path) -> None:
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    await history.flush()
    for file in tmp_path.iterdir():
        file.unlink()
    history.path.write_text("no database, by now")
    with pytest.raises(HistoryError, match="can't be read"):
        await history.last_number()
    with pytest.raises(HistoryError, match="can't be read"):
        await history.by_arrival(1).asend(None)
    await asyncio.to_thread(history.close)


async def test_a_reader_that_stands_still_keeps_the_log_from_nothing(tmp_path: Path) -> None:
    """A read that stays open keeps all that is written since in the database's log, which then grows without bound."""
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 2501)))
    for reading in (history.by_arrival(1), history.steps(1, 0)):
        async with aclosing(reading) as pages:
            assert len(await anext(pages)) == FIRST_PAGE  # and it asks for no more for now
            _, last = await history.extent(1)
            await add(history, *(step(last + i) for i in range(1, 501)))
            with closing(sqlite3.connect(history.path)) as database:
                busy, _, _ = database.execute("PRAGMA wal_checkpoint(RESTART)").fetchone()
            assert not busy
            assert sum([len(page) async for page in pages]) >= 1500
    await asyncio.to_thread(history.close)


class Watched(sqlite3.Connection):
    """A connection that notes whether it is closed while a statement runs, which can end the process."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self.begun, self.going, self.closed = threading.Event(), threading.Event(), threading.Event()
        self.runs = self.closed_too_early = False
        self.create_function("pause", 0, self._pause)

    def _pause(self) -> int:
        self.runs = True
        self.begun.set()
        self.going.wait(PATIENCE)
        self.runs = False
        return 1

    def close(self) -> None:
        self.closed_too_early = self.runs
        if not self.runs:
            super().close()
        self.closed.set()


async def test_no_connection_is_closed_that_a_thread_still_reads_with(tmp_path: Path) -> None:
    """Who asks for a long trace may leave at any time."""
    with closing(sqlite3.connect(tmp_path / "history.sqlite")) as database:
        database.execute("CREATE TABLE steps (position)")
    watched = sqlite3.connect(
        tmp_path / "history.sqlite", isolation_level=None, check_same_thread=False, factory=Watched
    )

    class Given(SqliteReader):
        def _connect(self) -> sqlite3.Connection:
            return watched

    readers = Readers(1, 1)
    pages = Given(tmp_path / "history.sqlite", readers).pages(
        tuple, "SELECT pause() AS key", "SELECT key FROM sorted WHERE rowid BETWEEN ? AND ?", (), 10
    )
    reading = asyncio.ensure_future(anext(pages))
    assert await asyncio.to_thread(watched.begun.wait, PATIENCE)
    reading.cancel()
    with pytest.raises(asyncio.CancelledError):
        await reading
    free = readers.start(lambda: "free")
    watched.going.set()
    assert await asyncio.to_thread(watched.closed.wait, PATIENCE)
    assert not watched.closed_too_early
    async with asyncio.timeout(PATIENCE):
        assert await free == "free", "its place is another's"


async def test_what_a_decision_waits_for_waits_for_no_other_reader(tmp_path: Path) -> None:
    """Who reads long histories takes all of the threads for that, for seconds."""
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, step(1, decision=Decision("deny", ("p",))))
    asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
    going = threading.Event()
    others = asyncio.gather(asyncio.to_thread(going.wait), *(history.in_thread(going.wait) for _ in range(20)))
    try:
        async with asyncio.timeout(PATIENCE):
            found = await history.asked_step(1, "m", 1)
            assert found is not None
            assert found.decision == Decision("deny", ("p",))
            assert await history.session("s") == opened()
            assert await history.closed_state("s") is None
        assert not others.done()
    finally:
        going.set()
    await others
    await asyncio.to_thread(history.close)


async def test_a_snapshot_that_can_not_be_decoded_has_no_data(tmp_path: Path) -> None:
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.save_snapshot(1, SnapshotRecord(3, {"a": 1}, 2, {"m": [1, 0, []]}))
    await history.flush()
    with closing(sqlite3.connect(history.path)) as database, database:
        database.execute("UPDATE snapshots SET data = substr(data, 2)")
    assert await history.snapshot(1) == SnapshotRecord(3, None, 2, {"m": [1, 0, []]})
    await asyncio.to_thread(history.close)


async def test_the_ends_of_sessions_are_found_without_a_look_at_what_is_between(tmp_path: Path) -> None:
    """Else the start of a server takes minutes where much is kept, and each page of a reader a second."""
    history, looks = SqliteHistory(tmp_path), 0

    class Counted(SqliteReader):
        def _connect(self) -> sqlite3.Connection:
            def looked() -> None:
                nonlocal looks
                looks += 1

            connection = super()._connect()
            connection.set_progress_handler(looked, 10)
            return connection

    async def asked() -> tuple[int, Any]:
        nonlocal looks
        looks = 0
        answers = [await history.last_time(), await history.extent(1), *await history.extents()]
        return looks, answers

    history._reader = Counted(history.path, Readers())
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, *(step(i) for i in range(1, 11)))
    few, answers = await asked()
    assert answers[:2] == [1000, (1, 10)]
    await add(history, *(step(i) for i in range(11, 2001)))
    many, answers = await asked()
    assert answers[:2] == [200_000, (1, 2000)]
    assert many <= few + 2
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("sql", [AMEND, ASKED])
def test_the_step_at_which_an_event_was_decided_is_found_without_a_look_at_others(sql: str, tmp_path: Path) -> None:
    """Else what adapters did with 20,000 messages takes minutes to write, for which nothing is committed."""
    with closing(SqliteStore(tmp_path / "history.sqlite", "normal")) as store:
        plan = store.database.execute(f"EXPLAIN QUERY PLAN {sql}", [None] * sql.count("?")).fetchall()
    assert [row[-1] for row in plan if "steps" in row[-1]] == [
        "SEARCH steps USING PRIMARY KEY (session=? AND position=?)",
        "SEARCH steps USING COVERING INDEX steps_by_seq (session=? AND monitor=? AND seq=?)",
    ]


async def test_what_sorts_a_long_history_keeps_no_page_waiting(tmp_path: Path) -> None:
    """A download begins by putting all steps in order."""
    history, going = SqliteHistory(tmp_path), threading.Event()
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, step(1), step(2))
    sorts = [history._sorters.start(going.wait) for _ in range(THREADS + 1)]
    downloads = []
    try:
        async with asyncio.timeout(PATIENCE):
            for i in range(THREADS + 1):
                with reading_for(f"client {i}"):
                    downloads.append(asyncio.ensure_future(anext(history.by_arrival(1))))
            assert await history.step(1, 1) is not None
            going.set()
            assert [len(page) for page in await asyncio.gather(*downloads)] == [2] * (THREADS + 1)
    finally:
        going.set()
    await asyncio.gather(*sorts)
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("order", ["asc", "desc"])
async def test_a_search_is_cut_into_turns_and_finds_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, order: Literal["asc", "desc"]
) -> None:
    """Else one that finds nothing would read all of a session at one turn."""
    monkeypatch.setattr(matching, "_SCAN", 5)
    monkeypatch.setattr(matching, "_PAGE", 3)
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, *(step(i, stream="/b" if i in (1, 2, 30, 60) else "/a") for i in range(1, 61)))
    with closing(sqlite3.connect(history.path)) as reader:
        for stream, positions in (("/b", {1, 2, 30, 60}), ("/c", set()), (None, set(range(1, 61)))):
            query = Query(stream=stream, order=order, limit=1000)
            found, turns = [], 0
            position: int | None = query.start(2)
            while position is not None:
                records, position = matching.told(reader, opened(), query, position, None)
                found += [n for n, _ in records]
                turns += 1
            numbers = {n for position in positions for n in (2 * position - 1, 2 * position)}
            assert found == sorted(numbers, reverse=order == "desc")
            assert turns >= 10
            assert [record["n"] for record in (await find(history, opened(), query))[0]] == found
    await asyncio.to_thread(history.close)
