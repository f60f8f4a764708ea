"""What can't be kept of a session ends the history of that session, and of no other."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest
from structlog.testing import capture_logs

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.records import MonitorRecord, Refusal, SnapshotRecord, StoredStep
from oracle_server.history.sqlite.history import SqliteHistory
from tests.history.making import opened, step
from tests.history.test_port import collected
from tests.processes import PATIENCE

LONE = "\ud800"
"""Half of a pair of surrogates, which no encoding has."""


def saying(value: Any) -> StoredStep:
    """The third step, of which a signal has a value."""
    made = step(3)
    return msgspec.structs.replace(made, step=msgspec.structs.replace(made.step, signals={"v": value}))


BAD = {
    "too large an integer": step(3, arrived=2**63),
    "a number before all numbers": step(3, stamp=-(2**70)),
    "half a character in a name": step(3, monitor=f"m{LONE}"),
    "half a character in a signal": saying(LONE),
    "a signal that is no JSON": saying(object()),
    "half a character in an explanation": step(3, stream=f"/{LONE}", violated=[0]),
    "a position that is taken": step(2, seq=9),
    "a number that is taken": step(3, seq=1),
    "too long a text": saying("x" * 200_000),
}


async def finished(history: History) -> None:
    async with asyncio.timeout(PATIENCE):
        await history.flush()


@pytest.fixture
async def two(history: History) -> History:
    """A history with two sessions, in which no value may be longer than 100,000 bytes where a backend knows a limit."""
    if isinstance(history, SqliteHistory):
        history.store.database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 100_000)
    for number, name in ((1, "one"), (2, "two")):
        history.open_session(opened(number, name))
    await finished(history)
    return history


@pytest.mark.parametrize("bad", BAD.values(), ids=BAD.keys())
async def test_a_row_that_can_not_be_kept_stops_no_other_session(two: History, bad: StoredStep) -> None:
    told: list[str] = []

    def give(session: int, what: str, *steps: StoredStep) -> None:
        two.append(session, steps, lambda: told.append(what))

    give(2, "other, before", step(1))
    give(1, "own, before", step(1), step(2))
    give(1, "bad", bad)
    give(2, "other, behind", step(2), step(3))
    give(1, "own, behind", step(4))
    await finished(two)
    give(2, "other, later", step(4))
    give(1, "own, later", step(5))
    await finished(two)
    assert two.failure is None
    assert (two.failure_of(2), two.has_room, two.pending) == (None, True, 0)
    assert [what for what in told if "other" in what] == ["other, before", "other, behind", "other, later"]
    assert await collected(two.steps(2, 0)) == [step(1), step(2), step(3), step(4)]
    if two.failure_of(1) is None:  # a backend that can keep it, keeps it
        assert isinstance(two, MemoryHistory) or (isinstance(two, PostgresHistory) and bad == BAD["too long a text"])
        assert "bad" in told
    else:
        assert [what for what in told if "own" in what or what == "bad"] == ["own, before"]
        assert await collected(two.steps(1, 0)) == [step(1), step(2)]


def test_only_a_history_in_memory_keeps_what_is_no_row(tmp_path: Path) -> None:
    """Of the bad rows it refuses those only that are no JSON; SQLite refuses all."""
    refused: dict[str, set[str]] = {"sqlite": set(), "memory": set()}

    async def ask(what: str, bad: StoredStep) -> None:
        for name, history in (("sqlite", SqliteHistory(tmp_path)), ("memory", MemoryHistory())):
            history.start(asyncio.get_running_loop())
            if isinstance(history, SqliteHistory):
                history.store.database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, 100_000)
            number = await history.last_number() + 1
            history.open_session(opened(number, what))
            history.append(number, [step(1), step(2)], lambda: None)
            history.append(number, [bad], lambda: None)
            await finished(history)
            if history.failure_of(number) is not None:
                refused[name].add(what)
            await asyncio.to_thread(history.close)

    for what, bad in BAD.items():
        asyncio.run(ask(what, bad))
    assert refused["sqlite"] == BAD.keys()
    assert refused["memory"] == {"half a character in an explanation"}


async def test_whatever_else_of_a_session_can_not_be_kept_stops_no_other(two: History) -> None:
    commands: dict[str, Callable[[], None]] = {
        "monitor": lambda: two.set_monitor(1, MonitorRecord(LONE, "i", (), attached=True, clock="wall")),
        "refusal": lambda: two.refuse(1, Refusal("m", 2**63, 0, 5, "bad_event", "no"), lambda: None),
        "amendment": lambda: two.amend(1, "m", 2**70, (True, "decision"), lambda: None),
        "begin": lambda: two.begin_session(1, 2**63),
    }
    for what, command in commands.items():
        command()
        done = asyncio.Event()
        two.set_monitor(2, MonitorRecord(what, "i", (), attached=True, clock="wall"), done.set)
        async with asyncio.timeout(PATIENCE):
            await done.wait()
    assert sorted(monitor.name for monitor in await two.monitors(2)) == sorted(commands)
    assert two.failure is None
    assert two.failure_of(2) is None


async def test_a_session_that_can_not_be_opened_is_none(two: History) -> None:
    two.open_session(opened(3, f"three{LONE}")._replace(text=f"id: {LONE}"))
    two.open_session(opened(4, "four"))
    await finished(two)
    assert [session.id for session in await two.open_sessions()][-1] == "four"
    assert (two.failure_of(3) is None) == isinstance(two, MemoryHistory)
    assert two.failure_of(4) is None


async def test_a_session_goes_on_without_a_snapshot_that_can_not_be_kept(two: History) -> None:
    two.save_snapshot(1, SnapshotRecord(1, {"kept": 1}))
    two.save_snapshot(1, SnapshotRecord(2, {"v": LONE}))
    two.append(1, [step(1)], lambda: None)
    await finished(two)
    assert two.failure_of(1) is None
    assert await two.snapshot(1) == SnapshotRecord(1, {"kept": 1})
    assert await two.extent(1) == (1, 1)


async def test_a_session_of_which_nothing_more_can_be_kept_is_closed_and_forgotten(two: History) -> None:
    two.append(1, [step(1)], lambda: None)
    two.append(1, [step(2, violated=[0], stream=LONE)], lambda: None)
    closed: list[str] = []
    two.close_session(1, 5, {"id": LONE}, lambda: closed.append("a state that can't be kept"))
    await finished(two)
    assert closed == []
    assert [session.id for session in await two.open_sessions()] == ["one", "two"]
    two.close_session(1, 5, {"id": "one"}, lambda: closed.append("a state"))
    await finished(two)
    assert closed == ["a state"]
    assert await two.closed_state("one") == {"id": "one"}
    assert [session.id for session in await two.open_sessions()] == ["two"]
    async with asyncio.timeout(PATIENCE):
        await two.forget_steps(1, 2)
        assert await two.extent(1) == (1, 0)
        await two.forget_session(1)
    assert await two.session("one") is None


async def test_it_is_logged_once_by_the_name_of_the_session(tmp_path: Path) -> None:
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    history.open_session(opened(1, "flight1"))
    with capture_logs() as logs:
        for position in (2**63, 2, 3):
            history.append(1, [step(position)], lambda: None)
            await finished(history)
    assert [(line["event"], line["session"]) for line in logs] == [("nothing more of a session can be kept", "flight1")]
    assert "too large" in logs[0]["reason"]
    assert history.failure_of(1) == logs[0]["reason"]
    await asyncio.to_thread(history.close)


async def test_what_is_committed_with_a_bad_row_outlives_the_process(tmp_path: Path) -> None:
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    for number in (1, 2, 3):
        history.open_session(opened(number, f"s{number}"))
        history.append(number, [step(1)], lambda: None)
        history.append(number, [step(2 if number != 2 else 2**63)], lambda: None)
    await asyncio.to_thread(history.close)  # what waits is committed
    with closing(sqlite3.connect(history.path)) as database:
        found = database.execute("SELECT session, position FROM steps ORDER BY 1, 2").fetchall()
    assert found == [(1, 1), (1, 2), (2, 1), (3, 1), (3, 2)]


async def test_what_follows_a_commit_of_one_session_keeps_no_other_from_hearing_of_its_own(history: History) -> None:
    loop = asyncio.get_running_loop()
    failures: list[Any] = []
    loop.set_exception_handler(lambda _, context: failures.append(context["exception"]))
    history.open_session(opened())

    def fails() -> None:
        raise RuntimeError("of one session")

    history.append(1, [step(1)], fails)
    told = asyncio.Event()
    history.append(2, [step(1)], told.set)
    async with asyncio.timeout(PATIENCE):
        await told.wait()
    assert [str(failure) for failure in failures] == ["of one session"]


async def test_what_stands_of_a_session_and_can_not_be_told_stops_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_: object) -> dict[int, Any]:
        raise AssertionError("a revision of nothing")

    monkeypatch.setattr("oracle_server.history.sql.batch.restated", fail)
    history = SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    for number in (1, 2):
        history.open_session(opened(number, f"s{number}"))
    revision: Any = SimpleNamespace(standing={})
    history.append(1, [step(1)], lambda: None, [revision])
    history.append(2, [step(1)], lambda: None)
    await finished(history)
    assert (history.failure, history.failure_of(2)) == (None, None)
    assert history.failure_of(1) == "AssertionError: a revision of nothing"
    assert await collected(history.steps(1, 0)) == []
    assert await collected(history.steps(2, 0)) == [step(1)]
    await asyncio.to_thread(history.close)


async def test_nothing_is_kept_of_a_session_that_is_stopped(two: History) -> None:
    two.append(1, [step(1)], lambda: None)
    two.stop(1, "enough")
    two.append(1, [step(2)], lambda: None)
    two.append(2, [step(1)], lambda: None)
    await finished(two)
    assert (two.failure_of(1), two.failure_of(2)) == ("enough", None)
    assert await collected(two.steps(1, 0)) == [step(1)]
    assert await collected(two.steps(2, 0)) == [step(1)]
