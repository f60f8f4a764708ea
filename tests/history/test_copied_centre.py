"""A centre's history that is copied: robots' sessions stay theirs, and robots go on with the copy."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from oracle_server.history.copying import run
from oracle_server.history.copying.ends import End
from oracle_server.history.copying.inpostgres import PostgresEnd
from oracle_server.history.copying.insqlite import SqliteEnd
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.port import History
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.records import MonitorRecord
from oracle_server.history.sqlite.beside import SqliteBeside
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.sessions.elsewhere import Others, OtherServerError
from tests.history.forwarded import ORIGIN, at_the_centre, at_the_robot, brought, names, robot
from tests.history.making import add, opened, step
from tests.postgres import Postgres

THERE = f"s@{ORIGIN}"


async def flying(history: SqliteHistory) -> None:
    """A robot's session that is open, with its monitor."""
    history.open_session(opened())
    history.set_monitor(1, MonitorRecord("m", "i", (), attached=True, clock="wall"))
    await add(history, step(1), step(2, violated=[0]))


async def own_session(url: str) -> None:
    """A session of the centre's own, which is open too."""
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())
    number = await centre.reserve("own", 0)
    assert number is not None
    centre.open_session(opened(number, "own"))
    await centre.flush()
    await asyncio.to_thread(centre.close)


def copied(source: End, target: End, told: Callable[..., None] = lambda *_, **__: None) -> None:
    with closing(source), closing(target):
        run.copy(source, target, told)


@pytest.mark.parametrize("to", ["sqlite", "postgres", "beside", "postgres by sqlite"])
async def test_sessions_that_robots_forward_are_nobody_elses_in_a_copy(
    to: str, postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    (tmp_path / "robot").mkdir()
    async with robot(tmp_path / "robot") as there:
        await flying(there)
        await brought(there, url, bringing)
    bringing.close()
    await own_session(url)
    if to != "postgres":
        copied(PostgresEnd(url), SqliteEnd(str(tmp_path), source=False))
    target = postgres.empty() if to.startswith("postgres") else ""
    if target:
        source = PostgresEnd(url) if to == "postgres" else SqliteEnd(str(tmp_path), source=True)
        copied(source, PostgresEnd(target))
        postgres.do("UPDATE origins SET heard = '2026-01-02 03:04:59+00'", target)
        history: History = PostgresHistory(target)
    else:
        history = SqliteBeside(tmp_path) if to == "beside" else SqliteHistory(tmp_path)
    history.start(asyncio.get_running_loop())
    mine = [*await history.open_sessions(), *await history.take_over([])]
    assert THERE not in [session.id for session in mine]
    assert ("own" in [session.id for session in mine]) == (to != "beside")
    others = Others(history)
    found = [state for state in await others.states() if state["id"] == THERE]
    assert found == await others.states(ORIGIN) == [await others.state(THERE)]
    assert await others.states("robot8") == await others.states("Robot7") == []
    (state,) = found
    assert (state["origin"], state["live"], state["node"], state["status"]) == (ORIGIN, False, None, "open")
    assert [each["violations"] for each in state["properties"]] == [0, 0]
    assert "was heard last at" in state["trouble"] if to == "postgres" else "does not forward" in state["trouble"]
    assert await others.has(THERE)
    with pytest.raises(OtherServerError, match=f"is forwarded from '{ORIGIN}'"):
        await others.demand_own(THERE)
    refused = await others.moved(THERE, known=True)
    assert refused is not None
    assert refused.code == "bad_attach"
    await asyncio.to_thread(history.close)


async def test_a_robot_goes_on_with_the_copy_where_it_was(postgres: Postgres, tmp_path: Path) -> None:
    url, target, bringing = postgres.empty(), postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        await flying(history)
        await brought(history, url, bringing)
        bringing.close()
        copied(PostgresEnd(url), PostgresEnd(target))
        await add(history, step(3))
        history.open_session(opened(2, "t"))
        await add(history, step(1), session=2)
        told = await brought(history, target, bringing)
        bringing.close()
        assert told.rows < 6, "what was there is not brought again"
        assert len({which for which, _ in names(target).values()}) == 1
        with closing(PostgresEnd(target)) as end:
            assert end.execute("SELECT id FROM sessions ORDER BY number").fetchall() == [(THERE,), (f"t@{ORIGIN}",)]
        assert at_the_centre(target) == at_the_robot(tmp_path)


async def test_what_robots_bring_while_the_centre_is_copied_is_brought_again(
    postgres: Postgres, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A robot writes to the centre's database without a server: a copy that is made meanwhile has a part."""
    monkeypatch.setattr(run, "_ROWS", 2)
    url, bringing, loop = postgres.empty(), Bringing(), asyncio.get_running_loop()
    async with robot(tmp_path) as history:
        await flying(history)
        await brought(history, url, bringing)
        count = 1

        async def fly() -> None:
            nonlocal count
            count += 1
            await add(history, *(step(p) for p in (count * 2 - 1, count * 2)))
            history.open_session(opened(count, f"s{count}"))
            await add(history, *(step(p) for p in range(1, 6)), session=count)
            history.amend(1, "m", count, (True, "why"), lambda: None)
            await history.flush()
            await brought(history, url, bringing)

        def meanwhile(*_: object, **__: object) -> None:
            if count < 8:
                asyncio.run_coroutine_threadsafe(fly(), loop).result()

        target = postgres.empty()
        await asyncio.to_thread(copied, PostgresEnd(url), PostgresEnd(target), meanwhile)
        bringing.close()
        await brought(history, target, bringing)
        bringing.close()
        assert len(names(target)) == count > 3
        assert at_the_centre(target) == at_the_robot(tmp_path)
        with closing(PostgresEnd(target)) as end:
            ids = sorted(each for (each,) in end.execute("SELECT id FROM sessions").fetchall())
        assert ids == sorted([THERE, *(f"s{n}@{ORIGIN}" for n in range(2, count + 1))])


async def test_a_new_number_at_a_copy_is_nobodys(postgres: Postgres, tmp_path: Path) -> None:
    """Also not that of a session which the centre has deleted, and a robot has told of."""
    url, target, bringing = postgres.empty(), postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        await flying(history)
        await brought(history, url, bringing)
        bringing.close()
        (number,) = names(url)
        centre = PostgresHistory(url)
        centre.start(asyncio.get_running_loop())
        await centre.forget_session(number)
        await asyncio.to_thread(centre.close)
        copied(PostgresEnd(url), PostgresEnd(target))
        history.open_session(opened(2, "t"))
        await add(history, msgspec.structs.replace(step(1), judged=3), session=2)
        await brought(history, target, bringing)
        bringing.close()
        assert sorted(at for _, at in names(target).values()) == [1, 2]
