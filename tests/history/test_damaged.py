"""Rows that can't be read, as where a disk has failed: it is told which, and all others are served."""

from __future__ import annotations

import asyncio
import sqlite3
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
import structlog.testing

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.query import Query
from oracle_server.history.records import MonitorRecord, Refusal
from oracle_server.history.sqlite.history import SqliteHistory
from tests.history.making import opened, step
from tests.postgres import Postgres

PLACE = "the history is damaged: the step at position 2 of session number 1 can't be read "


@pytest.fixture
async def history(tmp_path: Path) -> AsyncIterator[SqliteHistory]:
    history = SqliteHistory(tmp_path, "normal")
    history.start(asyncio.get_running_loop())
    for number in (1, 2):
        history.open_session(opened(number, f"s{number}"))
        history.set_monitor(number, MonitorRecord("m", "i", (), True, "wall"))
        history.append(number, [step(1), step(2, violated=(1,)), step(3)], lambda: None)
        history.refuse(number, Refusal("m", 9, 0, 1, "bad_event", "why"), lambda: None)
    history.close_session(1, 5, {"id": "s1"})
    await history.flush()
    yield history
    await asyncio.to_thread(history.close)


def damage(tmp_path: Path, change: str) -> None:
    """Change rows of session 1 as no server does."""
    with sqlite3.connect(tmp_path / "history.sqlite") as database:
        assert database.execute(f"UPDATE {change}").rowcount == 1
    database.close()


@pytest.mark.parametrize(
    "change",
    [
        "outcomes = 'tx'",
        "outcomes = 't'",
        "degraded = 7",
        "ord = 'sideways'",
        "kind = 'gaol'",
        "stream = x'ff'",
        "stamp = 'now'",
        "judged = 1.5",
        "signals = '{\"v\":'",
        "signals = '[1]'",
        "explanations = '[]'",
        "failed = ''",
        "standing = 'x', standing_degraded = '00'",
        "robustness = '[\"a\"]'",
        "unheard = '7'",
        "pending = '{\"p\": 1}'",
    ],
)
async def test_a_step_that_can_not_be_read_is_told(tmp_path: Path, history: SqliteHistory, change: str) -> None:
    damage(tmp_path, f"steps SET {change} WHERE session = 1 AND position = 2")
    with pytest.raises(HistoryError) as told:
        await history.step(1, 2)
    assert str(told.value).startswith(PLACE)
    with pytest.raises(HistoryError) as told:
        [_ async for _ in history.steps(1, 0)]
    assert str(told.value).startswith(PLACE)
    with pytest.raises(HistoryError) as told:
        [_ async for _ in history.by_arrival(1)]
    assert str(told.value).startswith(PLACE)
    with pytest.raises(HistoryError) as told:
        await history.told(opened(1, "s1"), Query(frozenset()), 1)
    assert str(told.value).startswith(PLACE)
    assert len((await history.told(opened(2, "s2"), Query(frozenset()), 1)).records) == 6
    assert await history.last_time() == 300


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("monitors SET left_at = 'x' WHERE session = 1", "monitor m of session number 1"),
        ("monitors SET streams = '7' WHERE session = 1", "monitor m of session number 1"),
        ("monitors SET clock = 'sun' WHERE session = 1", "monitor m of session number 1"),
        ("refused SET gap = 'x' WHERE session = 1", "the refused event 9 of monitor m of session number 1"),
        ("sessions SET properties = '[1]' WHERE number = 1", "session number 1"),
        ("sessions SET state = '{' WHERE number = 1", "the state of session s1"),
    ],
)
async def test_what_else_can_not_be_read_is_told(
    tmp_path: Path, history: SqliteHistory, change: str, what: str
) -> None:
    damage(tmp_path, change)
    with pytest.raises(HistoryError) as told:
        await read(history)
    assert str(told.value).startswith(f"the history is damaged: {what} can't be read ")
    assert [monitor.name for monitor in await history.monitors(2)] == ["m"]


async def read(history: SqliteHistory) -> None:
    """Read what is kept of session 1 beside its steps."""
    await history.monitors(1)
    await history.refusals(1)
    await history.session("s1")
    await history.closed_state("s1")


async def test_a_time_that_is_none_keeps_no_server_from_starting(tmp_path: Path, history: SqliteHistory) -> None:
    damage(tmp_path, "steps SET judged = '[]' WHERE session = 1 AND position = 3")
    assert await history.last_time() == 300


async def test_a_closed_session_whose_state_can_not_be_read_hides_no_other(
    tmp_path: Path, history: SqliteHistory
) -> None:
    history.close_session(2, 6, {"id": "s2"})
    await history.flush()
    damage(tmp_path, "sessions SET state = '{' WHERE number = 1")
    with structlog.testing.capture_logs() as logs:
        for _ in range(2):
            assert await history.closed_states(10) == [{"id": "s2"}]
    assert [line["error"][:64] for line in logs] == ["the history is damaged: the state of session s1 can't be read (D"]


async def test_sessions_that_can_not_be_read_hide_no_others_in_postgresql(postgres: Postgres) -> None:
    url = postgres.empty()
    history = await asyncio.to_thread(PostgresHistory, url)
    history.start(asyncio.get_running_loop())
    for number in range(1, 5):
        history.open_session(opened(number, f"s{number}"))
    for number in (1, 2):
        history.close_session(number, 5, {"id": f"s{number}"})
    await history.flush()
    postgres.do("UPDATE sessions SET state = '{' WHERE number = 1", url)
    postgres.do("UPDATE sessions SET properties = '[1]' WHERE number = 3", url)
    assert await history.closed_states(10) == [{"id": "s2"}]
    assert [session.id for session in await history.open_sessions()] == ["s4"]
    with pytest.raises(HistoryError, match="the history is damaged: session number 3 can't be read"):
        await history.session("s3")
    await asyncio.to_thread(history.close)
