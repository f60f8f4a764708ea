"""Who holds a database in PostgreSQL: a server whose lease runs out, or that has been taken over, decides nothing."""

from __future__ import annotations

import asyncio
import socket
import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres import leases, store
from oracle_server.history.postgres.history import PostgresHistory
from tests.history.making import add, opened, step
from tests.history.test_postgres import begun, until
from tests.postgres import Postgres
from tests.processes import PATIENCE


async def test_a_second_server_of_the_same_name_is_refused(postgres: Postgres) -> None:
    url = postgres.empty()
    first = await begun(url, 0.5)
    with pytest.raises(HistoryError, match=rf"is the node 'server' of this database \({socket.gethostname()}, process"):
        await begun(url)
    await asyncio.to_thread(first.close)
    second = await begun(url)
    await asyncio.to_thread(second.close)


async def test_a_server_that_stood_still_for_too_long_decides_and_writes_nothing_more(postgres: Postgres) -> None:
    url, ended = postgres.empty(), threading.Event()
    first = await asyncio.to_thread(PostgresHistory, url, 0.5, ended.set)  # and its writer does not run yet
    first.open_session(opened())
    await until(lambda: first.failure is not None)
    second = await begun(url)
    second.open_session(opened(2, "other"))
    await second.flush()
    first.start(asyncio.get_running_loop())
    assert await asyncio.to_thread(ended.wait, PATIENCE)
    assert "another server has taken over" in str(first.failure)
    assert first.adrift
    assert first.fenced
    assert [session.id for session in await second.open_sessions()] == ["other"]
    await asyncio.to_thread(first.close)
    await add(second, step(1), session=2)
    await asyncio.to_thread(second.close)


async def test_a_server_that_stood_still_hears_whether_it_is_a_node_before_it_decides(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else what comes until its lease is renewed would be `unknown`, though nobody has taken over."""
    monkeypatch.setattr(store, "_GRACE", PATIENCE)
    lease, asked = 60.0, threading.Event()
    node = await asyncio.to_thread(store.PostgresStore, postgres.empty(), lease, lambda: None, store.Node("a"))
    hold, stood = node._hold, 0.0

    def renewed_once_asked(*values: Any) -> None:
        assert asked.wait(PATIENCE)
        hold(*values)

    def ask() -> str | None:
        asked.set()
        return node.overdue

    monkeypatch.setattr(node, "_hold", renewed_once_asked)
    monkeypatch.setattr(store, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + stood))
    for _ in range(2):  # it may stand still again before it has renewed its lease once more
        asked.clear()
        stood += 2 * lease
        renewing = asyncio.create_task(asyncio.to_thread(node.renew))
        assert await asyncio.to_thread(ask) is None
        await renewing
    await asyncio.to_thread(node.close)


def test_a_server_waits_for_a_postgresql_that_always_answers_too_late_but_once(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """All sessions wait with it."""
    lease, waits = 60.0, list[float]()
    node = store.PostgresStore(postgres.empty(), lease, lambda: None, store.Node("a"))
    hold, wait_for, gone, late = node._hold, node._news.wait_for, 0.0, 0.0

    def held(*values: Any) -> None:
        nonlocal gone
        hold(*values)
        gone += late

    def waited(until: Callable[[], bool], seconds: float) -> bool:
        waits.append(seconds)
        return wait_for(until, 0)

    monkeypatch.setattr(node, "_hold", held)
    monkeypatch.setattr(node._news, "wait_for", waited)
    monkeypatch.setattr(store, "time", SimpleNamespace(monotonic=lambda: time.monotonic() + gone))
    told = []
    for late in (2 * lease, 2 * lease, 2 * lease, 0.0):  # noqa: B007 -- it is how long `held` takes
        node.renew()
        told.append((node.overdue is None, len(waits)))
    gone += 2 * lease
    told.append((node.overdue is None, len(waits)))
    assert told == [(False, 1), (False, 1), (False, 1), (True, 1), (False, 2)]
    node.close()


def test_a_lease_of_which_most_is_over_once_it_is_renewed_is_renewed_at_once(postgres: Postgres) -> None:
    node = store.PostgresStore(postgres.empty(), 0.3, lambda: None, store.Node("a"))
    node.transact(lambda database: database.execute("SELECT pg_sleep(0.2)"))
    assert node.renewal == 0
    node.close()


@pytest.mark.parametrize("connected", [False, True])
async def test_a_server_ends_where_the_database_has_lost_what_it_had_committed(
    connected: bool, postgres: Postgres
) -> None:
    """As a standby has it that lagged, or a backup that is put back while the server is `connected`.

    What follows would be kept behind a gap of which nobody is told.
    """
    url, ended = postgres.empty(), threading.Event()
    history = await begun(url, 0.5, ended.set)
    history.open_session(opened())
    await add(history, step(1))
    ((batch,),) = postgres.do("SELECT batch FROM nodes", url)
    await add(history, step(2))
    postgres.do("DELETE FROM steps WHERE position = 2", url)
    postgres.do(f"UPDATE nodes SET batch = {batch}", url)
    if not connected:
        await asyncio.to_thread(postgres.kill_backends)
    assert await asyncio.to_thread(ended.wait, PATIENCE)
    assert history.fenced is not None
    assert "PostgreSQL has not any more what this server had committed" in history.fenced
    history.append(1, [step(3)], lambda: None)
    await asyncio.to_thread(history.close)
    assert postgres.do("SELECT position FROM steps", url) == [(1,)]


async def test_a_lease_of_before_postgresqls_clock_was_set_back_is_waited_for_no_longer_than_any_lasts(
    postgres: Postgres, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where its machine starts with a clock that is behind: a server that started waited for hours, in silence."""
    monkeypatch.setattr(store, "LONGEST_LEASE", 1.0)
    monkeypatch.setattr(leases, "LONGEST_LEASE", 1.0)
    url = postgres.empty()
    first = await begun(url)
    first.open_session(opened())
    await asyncio.to_thread(first.close)
    postgres.do("UPDATE nodes SET until = clock_timestamp() + interval '1 hour'", url)
    with structlog.testing.capture_logs() as logs:
        async with asyncio.timeout(PATIENCE):
            second = await begun(url)
    assert any("PostgreSQL's clock was set back" in line["event"] for line in logs)
    assert [session.id for session in await second.open_sessions()] == [opened().id]
    await asyncio.to_thread(second.close)
