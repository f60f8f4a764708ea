"""What is deleted, here or at the centre, of a history that is forwarded."""

from __future__ import annotations

import asyncio
import shutil
import sqlite3
import time
from contextlib import closing
from pathlib import Path

import psycopg
import pytest

from oracle_server.core.episode import Episode
from oracle_server.core.spec import Retention
from oracle_server.history.copying.tables import tables
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.retention import Hold, Pruner
from oracle_server.history.sqlite.history import NAME
from tests.history.forwarded import ORIGIN, at_the_centre, at_the_robot, brought, names, robot
from tests.history.making import PROPERTIES, add, opened, step
from tests.postgres import Postgres


async def test_nothing_is_deleted_before_it_is_forwarded_up_to_a_size(
    postgres: Postgres, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        noted = history.forwarding
        assert noted is not None
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 31)))
        history.close_session(1, 1, {"id": "one", "trouble": None})
        history.open_session(opened(2, "two"))
        await add(history, *(step(p) for p in range(1, 31)), session=2)
        history.close_session(2, 2, {"id": "two", "trouble": None})
        await history.flush()

        def pruner(most: int) -> Pruner:
            return Pruner(history, Retention(events=5), dict, lambda age: -age, lambda _: None, Hold(noted.free, most))

        await pruner(10**9).prune()
        assert [await history.extent(n) for n in (1, 2)] == [(1, 30), (1, 30)]
        await brought(history, url, bringing, 20, once=True)
        await pruner(10**9).prune()
        assert [await history.extent(n) for n in (1, 2)] == [(21, 30), (1, 30)]
        assert "not forwarded yet" not in capsys.readouterr().out
        await pruner(1).prune()
        assert await history.extent(1) == (30, 30)
        assert "steps are deleted that are not forwarded yet" in capsys.readouterr().out
        told = await brought(history, url, bringing)
        bringing.close()
        await pruner(1).prune()
        assert await history.session(1) is None  # all of it is there now
        rows = at_the_centre(url)
        of_one = [row for row in rows["steps"] if row[0] == 1]
        assert sorted(row[1] for row in of_one) == [*range(1, 21), 30]
    centre = PostgresHistory(url)
    state = await centre.closed_state(f"one@{ORIGIN}")
    assert state is not None
    assert "21 to 29 are missing" in state["trouble"]
    record = await centre.session(f"one@{ORIGIN}")
    assert record is not None
    assert await centre.missing(record) == [(21, 29)]
    assert told.left == 0
    await asyncio.to_thread(centre.close)


@pytest.mark.parametrize("full", [False, True])
async def test_what_is_told_of_brought_steps_is_held_as_they_are(
    full: bool, postgres: Postgres, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Steps are brought first: episodes and blocks of a backlog come behind all of them."""
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        noted = history.forwarding
        assert noted is not None
        history.open_session(opened())
        for first in range(1, 401, 40):
            n = len(PROPERTIES) * (first + 9) + 1
            episode = StoredEpisode("p", "publication", Episode(n, 5, n, 7, open=False, final=False, count=3), "why")
            history.append(1, [step(p) for p in range(first, first + 40)], lambda: None, (), [episode])
        history.close_session(1, 1, {"id": "s", "trouble": None})
        await history.flush()
        kept = at_the_robot(tmp_path)
        assert len(kept["blocks"]) > 12
        hold = Hold(noted.free, 1 if full else 10**9)
        pruner = Pruner(history, Retention(events=5), dict, lambda age: -age, lambda _: None, hold)
        left = 1
        while left:
            left = (await brought(history, url, bringing, 100, once=True)).left
            await pruner.prune()
        bringing.close()
        assert await history.extent(1) == (396, 400)
    there = at_the_centre(url)
    lost = [table for table in ("steps", "episodes", "blocks") if there[table] != kept[table]]
    assert bool(lost) is ("or whose episodes are not" in capsys.readouterr().out) is full


async def test_what_is_deleted_is_noted_no_longer(tmp_path: Path) -> None:
    """Else the notes of a history that is forwarded no more would grow for ever."""
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 11)))
    with closing(sqlite3.connect(tmp_path / NAME)) as database:
        noted = "SELECT a FROM changes WHERE name = 'steps' ORDER BY a"
        database.execute("UPDATE steps SET judged = judged + 1")
        assert [*database.execute(noted)] == [(p,) for p in range(1, 11)]
        database.execute("DELETE FROM steps WHERE position < 8")
        assert [*database.execute(noted)] == [(8,), (9,), (10,)]


async def test_what_a_centre_has_lost_is_brought_again(postgres: Postgres, tmp_path: Path) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 50)))
        await brought(history, url, bringing)
        bringing.close()
        for sql in (
            "UPDATE forwarded SET position = 20", "DELETE FROM steps WHERE position > 20", "UPDATE origins SET seq = 0",
        ):  # fmt: skip
            postgres.do(sql, url)
        history.amend(1, "m", 3, (True, "why"), lambda: None)
        await history.flush()
        await brought(history, url, bringing)
        assert at_the_centre(url) == at_the_robot(tmp_path)
        empty = postgres.empty()
        bringing.close()
        await brought(history, empty, bringing)  # another database
        bringing.close()
        assert at_the_centre(empty) == at_the_robot(tmp_path)


async def test_a_session_of_which_retention_has_left_no_step_is_the_same_to_the_centre(
    postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        noted = history.forwarding
        assert noted is not None
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 11)))
        await brought(history, url, bringing)
        bringing.close()  # the network is gone
        history.close_session(1, 5, {"id": "one", "trouble": None})
        await history.flush()
        await Pruner(
            history, Retention(1), dict, lambda age: 10**18 - age, lambda _: None, Hold(noted.free, 10**9)
        ).prune()
        assert await history.extent(1) == (1, 0)
        assert await history.session(1) is not None, "that it was closed is not there yet"
        await brought(history, url, bringing)
        bringing.close()
    assert len(names(url)) == 1, "all would be there twice, as of two robots"
    rows = at_the_centre(url)
    assert sorted(row[1] for row in rows["steps"]) == [*range(1, 11)]
    assert rows["sessions"] == at_the_robot(tmp_path)["sessions"]


async def test_what_the_centre_has_deleted_stays_deleted(postgres: Postgres, tmp_path: Path) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        for number in (1, 2):
            history.open_session(opened(number, f"s{number}"))
            await add(history, *(step(p) for p in range(1, 50)), session=number)
        await brought(history, url, bringing)
        centre = PostgresHistory(url)
        centre.start(asyncio.get_running_loop())
        await centre.forget_session(1)
        await centre.forget_steps(2, 10)
        for number in (1, 2):
            history.amend(number, "m", 3, (True, "why"), lambda: None)
            await add(history, step(50), session=number)
        told = await brought(history, url, bringing)
        bringing.close()
        assert (told.lost, told.dropped) == (0, 1)
        assert await centre.session(1) is None
        assert [await centre.extent(n) for n in (1, 2)] == [(1, 0), (10, 50)]
        await asyncio.to_thread(centre.close)


def counted(postgres: Postgres, url: str) -> dict[str, object]:
    """How many rows there are of sessions, in the tables that have any; servers may use them."""
    counts = {t.name: postgres.do(f"SELECT count(*) FROM {t.name}", url)[0][0] for t in tables()}
    return {name: count for name, count in counts.items() if count}


async def test_what_was_closed_long_ago_is_as_old_as_it_is_at_the_centre(postgres: Postgres, tmp_path: Path) -> None:
    """A robot was offline for a month: its session is kept for as long as any other, from when all of it is there."""
    url, bringing, day = postgres.empty(), Bringing(), 24 * 3600 * 10**9
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())

    async def pruned(days: int) -> None:
        now = time.time_ns() + days * day
        await Pruner(centre, Retention(30 * day), dict, lambda age: now - age, lambda _: None).prune()

    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, *(step(p, violated=[0]) for p in range(1, 101)))
        history.close_session(1, time.time_ns() - 31 * day, {"id": "s", "continued_by": None})
        await history.flush()
        left = 1
        while left:
            told = await brought(history, url, bringing, 30, once=True)
            left = told.left
            assert (told.lost, told.dropped) == (0, 0)
            await pruned(0)
            await pruned(29)
        bringing.close()
    assert counted(postgres, url) == {"sessions": 1, "steps": 100, "blocks": 3}
    await pruned(31)
    assert counted(postgres, url) == {}
    await asyncio.to_thread(centre.close)


async def test_a_session_is_deleted_as_a_whole_or_later(postgres: Postgres, tmp_path: Path) -> None:
    """A robot brings something of it: nothing is deleted meanwhile, and no server waits for the robot."""
    url, bringing = postgres.empty(), Bringing()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())
    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, *(step(p) for p in range(1, 41)))
        await brought(history, url, bringing)
        bringing.close()
        there = counted(postgres, url)
        ((number,),) = postgres.do("SELECT number FROM sessions", url)
        assert isinstance(number, int)
        with psycopg.connect(url) as raw:
            raw.execute(f"SELECT 1 FROM sessions WHERE number = {number} FOR UPDATE")
            await centre.forget_session(number)
        assert counted(postgres, url) == there == {"sessions": 1, "steps": 40, "blocks": 1}
        await centre.forget_session(number)
        assert counted(postgres, url) == {}
    await asyncio.to_thread(centre.close)


@pytest.mark.parametrize("bounds", [Retention(1), Retention(events=50), Retention(size=200_000)])
async def test_what_a_robot_has_open_takes_no_room_from_others_at_the_centre(
    bounds: Retention, postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing, saved = postgres.empty(), Bringing(), list[int]()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())
    number = await centre.reserve("own", 1)
    assert number is not None
    centre.open_session(opened(number, "own"))
    await add(centre, *(step(p) for p in range(1, 31)), session=number)
    centre.close_session(number, 10**18, {"id": "own"})
    await centre.flush()
    async with robot(tmp_path) as history:
        history.open_session(opened())
        await add(history, *(step(p) for p in range(1, 2001)))
        await brought(history, url, bringing)
        bringing.close()
    await Pruner(centre, bounds, dict, lambda age: 10**18 - age, saved.append).prune()
    assert counted(postgres, url)["steps"] == 2030
    assert saved == [], "there is no judge of it here"
    await asyncio.to_thread(centre.close)


async def test_a_robot_that_was_put_back_is_another_one_also_where_the_centre_has_deleted_its_sessions(
    postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    image = tmp_path / "image"
    image.mkdir()
    async with robot(image) as history:
        history.open_session(opened(1, "first"))
        history.close_session(1, 5, {"id": "first", "continued_by": None})
        await history.flush()
        await brought(history, url, bringing)
        bringing.close()
    shutil.copytree(image, tmp_path / "used")
    async with robot(tmp_path / "used") as history:
        history.open_session(opened(2, "s"))
        await add(history, *(step(p) for p in range(1, 11)), session=2)
        history.close_session(2, 6, {"id": "s", "continued_by": None})
        await history.flush()
        await brought(history, url, bringing)
        bringing.close()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())
    for number in (1, 2):
        await centre.forget_session(number)
    await asyncio.to_thread(centre.close)
    async with robot(image) as history:
        history.open_session(opened(2, "new")._replace(opened=9_000))
        await add(history, *(step(p) for p in range(1, 31)), session=2)
        for p in range(1, 31):  # more has changed than the centre knows of
            history.amend(2, "m", p, (True, "why"), lambda: None)
        await history.flush()
        await brought(history, url, bringing)
        bringing.close()
    assert [row[2:] for row in postgres.do("SELECT count(*), min(position), max(position) FROM steps", url)] == [(30,)]
    assert postgres.do(f"SELECT count(*) FROM sessions WHERE id = 'new@{ORIGIN}'", url) == [(1,)]


async def test_what_was_closed_when_its_end_was_not_noted_stays_closed(postgres: Postgres, tmp_path: Path) -> None:
    """A centre of an older version did not note it; else one later change would open such a session for ever."""
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 11)))
        history.close_session(1, 1, {"id": "one", "trouble": None})
        await history.flush()
        await brought(history, url, bringing)
        postgres.do("UPDATE forwarded SET ended = NULL", url)
        history.amend(1, step(5).step.event.monitor, 5, (True, "late"), lambda: None)
        await history.flush()
        assert (await brought(history, url, bringing)).rows == 1
        bringing.close()
    assert at_the_centre(url)["sessions"] == at_the_robot(tmp_path)["sessions"]
