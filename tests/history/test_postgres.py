"""What is PostgreSQL's own: who holds a database, and what becomes of commits of which nobody has heard."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import psycopg
import pytest
from msgspec.structs import replace
from structlog.testing import capture_logs

from oracle_server.core.errors import HistoryError
from oracle_server.core.events import StreamKey
from oracle_server.history.pages import find
from oracle_server.history.postgres import connection, store
from oracle_server.history.postgres.dialect import decoded, encoded
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.query import Query
from oracle_server.history.records import MonitorRecord, Refusal, StoredStep
from tests.history.making import add, opened, step
from tests.history.test_port import collected
from tests.postgres import Postgres, Relay
from tests.processes import PATIENCE


async def begun(url: str, lease: float = 3.0, end: Callable[[], object] = lambda: None) -> PostgresHistory:
    history = await asyncio.to_thread(PostgresHistory, url, lease, end)
    history.start(asyncio.get_running_loop())
    return history


async def until(good: Callable[[], object]) -> None:
    async with asyncio.timeout(PATIENCE):
        while not good():
            await asyncio.sleep(0.01)


async def told(history: PostgresHistory, *steps: StoredStep) -> None:
    """Keep steps, and wait until that is told."""
    done = asyncio.Event()
    history.append(1, steps, done.set)
    async with asyncio.timeout(PATIENCE):
        await done.wait()


@pytest.mark.parametrize("name", ["synchronous_commit", "full_page_writes", "fsync"])
def test_a_server_by_which_what_is_acked_could_be_lost_is_refused(postgres: Postgres, name: str) -> None:
    url = postgres.empty()
    had: AbstractContextManager[None] = postgres.having(name, "off")
    if name == "synchronous_commit":
        url, had = f"{url}%20-c%20synchronous_commit%3Doff", nullcontext()
    with had, pytest.raises(HistoryError, match=f"PostgreSQL has {name} = off: what is acked could be lost"):
        PostgresHistory(url)


def test_it_is_told_whether_a_standby_has_what_is_committed(postgres: Postgres) -> None:
    with capture_logs() as logs:
        PostgresHistory(postgres.empty()).close()
    assert [line["event"] for line in logs] == [
        "the history has no synchronous standby: what is acked ends with PostgreSQL's disk"
    ]


def test_options_are_those_of_the_environment_where_the_url_has_none(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As libpq has it: two fleets that take their schemas from there were one, in the first schema of all."""
    monkeypatch.setenv("PGOPTIONS", f"-c search_path={postgres.part()}")
    PostgresHistory(postgres.url()).close()
    assert postgres.do("SELECT to_regclass('format') IS NOT NULL") == [(True,)]
    monkeypatch.delenv("PGOPTIONS")
    assert postgres.do("SELECT to_regclass('format') IS NOT NULL") == [(False,)]


def test_a_server_that_is_not_there_is_told_in_one_line() -> None:
    with pytest.raises(HistoryError) as raised:
        PostgresHistory("postgresql://nobody@/nothing?host=/nowhere")
    assert "/nowhere" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    "url", ["postgresql://u:top%secret@h/db", "postgresql://u:top%secret@[::1/db", "postgresql://h/db?top%secret"]
)
def test_a_url_that_can_not_be_read_is_told_without_the_password_in_it(url: str) -> None:
    with pytest.raises(HistoryError, match=r"the URL of PostgreSQL can't be read: .*`%` as `%25`") as told:
        PostgresHistory(url)
    assert "secret" not in str(told.value)


def test_a_format_of_a_newer_version_is_refused(postgres: Postgres) -> None:
    url = postgres.empty()
    PostgresHistory(url).close()
    postgres.do("UPDATE format SET version = 99", url)
    with pytest.raises(HistoryError, match="has format 99, and this version of the server reads up to"):
        PostgresHistory(url)


async def test_a_history_of_an_older_format_is_brought_to_this_one(postgres: Postgres) -> None:
    """What was kept before there were rows stays, no number is kept twice, and rows can be."""
    url = postgres.empty()
    older = await begun(url)
    older.open_session(opened())
    await told(older, step(1))
    await asyncio.to_thread(older.close)
    postgres.do("DROP INDEX steps_by_seq; ALTER TABLE steps DROP COLUMN row", url)
    postgres.do("CREATE UNIQUE INDEX steps_by_seq ON steps (session, monitor, seq, ord)", url)
    postgres.do("UPDATE format SET version = 10", url)
    history = await begun(url)
    whole = step(2).step
    rows = [replace(step(n), step=replace(whole, event=replace(whole.event, row=n - 2))) for n in (2, 3)]
    await told(history, *rows)
    assert await collected(history.steps(1, 0)) == [step(1), *rows]
    again = replace(step(4), step=step(1).step)
    history.append(1, [again], lambda: None)
    await until(lambda: history.failure_of(1))
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("text", ["", "a", "\0", "\1", "\0\1\0", "\1" + "0", "a\0b\1\1" + "1", "\\u0000", "0\0001"])
def test_a_text_comes_back_as_it_was(text: str) -> None:
    assert decoded(encoded(text)) == text
    assert "\0" not in encoded(text)


async def test_a_text_may_have_any_character(postgres: Postgres) -> None:
    strange = "\0a\1b\0" + "\\u0000\t\n'\"%s$1?é😀"
    history = await begun(postgres.empty())
    session = opened(1, f"s{strange}")._replace(text=strange, properties=(strange, "q"))
    history.open_session(session)
    monitor = MonitorRecord(strange, strange, (StreamKey(strange, "topic"),), attached=True, clock="wall")
    history.set_monitor(1, monitor)
    refusal = Refusal(strange, 5, 0, 7, strange, strange)
    history.refuse(1, refusal, lambda: None)
    made = step(1, monitor=strange, stream=strange, violated=[0])
    await add(history, made)
    assert await history.session(session.id) == session
    assert await history.names("s\0a") == [session.id]
    assert await history.monitors(1) == [monitor]
    assert await history.refusals(1) == [refusal]
    assert await collected(history.steps(1, 0)) == [made]
    await asyncio.to_thread(history.close)


async def test_what_was_committed_before_anybody_heard_of_it_is_not_committed_again(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    commit, lost = connection.Connection.commit, 0

    def commits(self: connection.Connection, *, first: bool) -> None:
        nonlocal lost
        if first:
            commit(self)
        if lost:
            lost -= 1
            self.interrupt()
            raise HistoryError("PostgreSQL: the connection is lost")
        if not first:
            commit(self)

    history = await begun(postgres.empty())
    history.open_session(opened())
    await history.flush()
    position = 0
    for first in (True, False) * 3:
        monkeypatch.setattr(connection.Connection, "commit", lambda self, first=first: commits(self, first=first))
        lost = 1
        position += 1
        await told(history, step(position))
        assert lost == 0
    assert await collected(history.steps(1, 0)) == [step(p) for p in range(1, position + 1)]
    assert history.failure_of(1) is None, "a row that is written twice would be refused"
    await asyncio.to_thread(history.close)


async def test_nothing_is_lost_or_twice_where_connections_end(postgres: Postgres) -> None:
    history = await begun(postgres.empty())
    history.open_session(opened())
    heard: list[int] = []
    for position in range(1, 201):
        history.append(1, [step(position)], lambda position=position: heard.append(position))  # type: ignore[misc]
        if position % 20 == 0:
            await asyncio.to_thread(postgres.kill_backends)
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert heard == [*range(1, 201)]
    await until(lambda: history.failure is None)
    assert await collected(history.steps(1, 0)) == [step(p) for p in range(1, 201)]
    await asyncio.to_thread(history.close)


async def test_nobody_notices_connections_that_have_ended_before_they_are_used_again(
    postgres: Postgres, capsys: pytest.CaptureFixture[str]
) -> None:
    """As by a restart, or a time limit for idle connections: what failed was asked for again, or was `unknown`."""
    history = await begun(postgres.empty(), lease=60.0)
    history.open_session(opened())
    await add(history, step(1))
    await asyncio.gather(*(history.extent(1) for _ in range(8)), told_of(history))
    await asyncio.to_thread(postgres.stop)
    await asyncio.to_thread(postgres.start)
    assert await asyncio.gather(*(history.extent(1) for _ in range(8))) == [(1, 1)] * 8
    assert await told_of(history) == 2
    await told(history, step(2))
    assert await history.extent(1) == (1, 2)
    assert history.failure is None
    assert "can't be written" not in capsys.readouterr().out
    await asyncio.to_thread(history.close)


async def told_of(history: PostgresHistory) -> int:
    """How many verdicts of the session are told, by the process that is asked for them."""
    found, _ = await find(history, opened(), Query())
    return len(found)


async def test_a_connection_that_is_left_in_the_midst_of_a_pipeline_is_not_used_again(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What ends in a pipeline may leave it open: no statement is taken then, nor is the connection closed."""
    history = await begun(postgres.empty())
    history.open_session(opened())
    await history.flush()
    executemany, left = connection.Connection.executemany, 0

    def leave(self: connection.Connection, sql: str, rows: Any) -> None:
        nonlocal left
        left += 1
        monkeypatch.setattr(connection.Connection, "executemany", executemany)
        self.raw.pgconn.enter_pipeline_mode()
        self.raw.pgconn.send_query_params(b"SELECT 1", None)
        self._timed(self.raw.pgconn.exit_pipeline_mode)

    monkeypatch.setattr(connection.Connection, "executemany", leave)
    history.set_monitor(1, MonitorRecord("m", "i", (), attached=True, clock="wall"))
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert left == 1
    await told(history, step(1))
    assert await collected(history.steps(1, 0)) == [step(1)]
    await asyncio.to_thread(history.close)


async def test_a_transaction_that_can_not_be_given_up_ends_with_its_connection(postgres: Postgres) -> None:
    node = store.PostgresStore(postgres.empty(), 3.0, lambda: None, store.Node("a"))
    failed = node._database
    assert failed is not None

    def work(database: connection.Connection) -> None:
        execute, raw = database.raw.execute, database.raw

        def cancelled(sql: bytes, *values: Any) -> Any:
            if sql == b"ROLLBACK":
                raise psycopg.errors.QueryCanceled("canceling statement due to statement timeout")
            return execute(sql, *values)

        raw.execute = cancelled  # type: ignore[method-assign, assignment]
        database.execute("SELECT 1/0")

    with pytest.raises(ValueError, match="division by zero"):
        node.transact(work)
    assert node.transact(lambda database: database.execute("SELECT 1").fetchone()) == (1,)
    assert node._database is not failed
    node.close()


def test_rows_may_take_longer_than_an_answer_may(postgres: Postgres) -> None:
    """It is silence that ends a connection: else what piled up in an outage would be begun again and again."""
    url = postgres.empty()
    postgres.do("CREATE TABLE many (x int)", url)
    one = connection.Connection(url, "test", patience=2)

    def slow() -> Iterator[int]:
        time.sleep(0.1)  # as a slow network does
        yield 1

    one.insert("many", [slow() for _ in range(25)], ["x"])  # type: ignore[misc]
    assert one.execute("SELECT count(*) FROM many").fetchone() == (25,)
    one.close()


async def test_a_server_outlives_its_database(postgres: Postgres) -> None:
    history = await begun(postgres.empty(), 0.5)
    history.open_session(opened())
    await add(history, step(1))
    await asyncio.to_thread(postgres.stop, "immediate")
    try:
        done = asyncio.Event()
        history.append(1, [step(2)], done.set)
        await until(lambda: history.failure is not None)
        assert not done.is_set()
        with pytest.raises(HistoryError):
            await history.extent(1)
    finally:
        await asyncio.to_thread(postgres.start)
    async with asyncio.timeout(PATIENCE):
        await done.wait()
    await until(lambda: history.failure is None)
    assert await collected(history.steps(1, 0)) == [step(1), step(2)]
    await asyncio.to_thread(history.close)


async def test_nothing_is_decided_while_the_database_is_silent(
    postgres: Postgres, relay: Relay, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "PATIENCE", 1.0)
    history = await begun(postgres.empty(relay), 0.5)
    history.open_session(opened())
    await add(history, step(1))
    relay.fall_silent()
    heard: list[int] = []
    history.append(1, [step(2)], lambda: heard.append(2))
    await until(lambda: history.failure is not None)
    history.append(1, [step(3)], lambda: heard.append(3))
    assert heard == []
    relay.speak()
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert heard == [2, 3]
    await until(lambda: history.failure is None)
    assert await collected(history.steps(1, 0)) == [step(1), step(2), step(3)]
    await asyncio.to_thread(history.close)


async def test_a_commit_that_hangs_is_made_once(postgres: Postgres, monkeypatch: pytest.MonkeyPatch) -> None:
    """A standby that has to have it and is gone keeps it for ever; another connection finds out that it is there."""
    monkeypatch.setattr(store, "PATIENCE", 1.0)
    url = postgres.empty()
    history = await begun(url, 0.5)
    history.open_session(opened())
    await add(history, step(1))
    heard: list[int] = []
    with postgres.having("synchronous_standby_names", "nobody"):
        history.append(1, [step(2)], lambda: heard.append(2))
        await until(lambda: history.failure is not None)
        assert heard == []
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert heard == [2]
    assert await collected(history.steps(1, 0)) == [step(1), step(2)]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("told", ["notice", "error"])
async def test_a_commit_that_an_administrator_cancels_is_not_told_before_a_standby_has_it(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch, told: str
) -> None:
    """PostgreSQL answers that it is committed, with a warning that a standby may not have it; a role may want none."""
    url = postgres.empty()
    postgres.do(f"ALTER ROLE tests SET client_min_messages = {told}")
    history = await begun(url, 0.5)
    history.open_session(opened())
    await add(history, step(1))
    monkeypatch.setattr(store, "PATIENCE", 1.0)
    heard: list[int] = []

    def cancel() -> object:
        postgres.do("SELECT pg_cancel_backend(pid) FROM pg_stat_activity WHERE wait_event = 'SyncRep'")
        return heard or history.failure is not None

    try:
        with postgres.having("synchronous_standby_names", "nobody"):
            history.append(1, [step(2)], lambda: heard.append(2))
            await until(cancel)
            assert heard == []
    finally:
        postgres.do("ALTER ROLE tests RESET client_min_messages")
    async with asyncio.timeout(PATIENCE):
        await history.flush()
    assert heard == [2]
    assert await collected(history.steps(1, 0)) == [step(1), step(2)]
    await asyncio.to_thread(history.close)


async def test_what_is_deleted_makes_room(postgres: Postgres) -> None:
    """PostgreSQL's files do not become smaller: by them, more and more would be deleted."""
    history = await begun(postgres.empty())
    history.open_session(opened())
    await add(history, *(step(p) for p in range(1, 2001)))
    before = await history.size()
    await history.forget_steps(1, 1801)
    assert await history.size() < before / 2
    await asyncio.to_thread(history.close)


def test_the_statements_are_the_same_for_every_value(postgres: Postgres) -> None:
    """A number is of another type where it is larger; a statement must take each."""
    url = postgres.empty()
    with psycopg.connect(url) as raw:
        raw.execute("CREATE TABLE numbers (n BIGINT)")
    made: Any = connection.Connection(url, "test", PATIENCE)
    for n in (0, 2**15, 2**31, 2**62, -(2**63)):
        made.execute("INSERT INTO numbers VALUES (?)", (n,))
        assert made.execute("SELECT n FROM numbers WHERE n = ?1 AND n <= ?1", (n,)).fetchall() == [(n,)]
    made.close()
