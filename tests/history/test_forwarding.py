"""A robot's history that is forwarded is the same one at the centre, whatever ends in between."""

from __future__ import annotations

import asyncio
import json
import os
import random
import signal
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import msgspec
import pytest

from oracle_server.core.episode import Episode, Worst
from oracle_server.core.errors import HistoryError
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding import centre as centre_module
from oracle_server.history.forwarding.messages import Ask
from oracle_server.history.forwarding.robot import _BEGUN_IN
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.records import stored_revision
from oracle_server.history.sql.schema import VERSION
from oracle_server.history.sqlite.history import NAME, SqliteHistory
from oracle_server.process.worker import receive, send
from tests.history.forwarded import ORIGIN, at_the_centre, at_the_robot, brought, names, robot
from tests.history.making import add, opened, revision, step
from tests.history.test_copying import STRANGE, fill
from tests.history.test_standing import FALSE, HELD, change, stands
from tests.postgres import Postgres


async def test_all_that_is_there_and_what_changes_later_comes_along(postgres: Postgres, tmp_path: Path) -> None:
    url = postgres.empty()
    await fill(SqliteHistory(tmp_path))  # before it was ever forwarded
    async with robot(tmp_path) as history:
        bringing = Bringing()
        told = await brought(history, url, bringing, 100)
        assert (told.left, told.oldest, told.lost) == (0, None, 0)
        assert at_the_centre(url) == at_the_robot(tmp_path)
        episode = StoredEpisode("p", "publication", Episode(900, 5, 9, 7, open=True, final=False, count=2), "why")
        history.append(2, [step(50 + p, monitor="B") for p in range(-8, 40)], lambda: None, (), [episode])
        await history.flush()
        await brought(history, url, bringing, 10)
        ended = msgspec.structs.replace(episode.episode, open=False, count=3, worst=Worst(2.5))
        history.append(2, [], lambda: None, (), [episode._replace(episode=ended)])
        history.amend(2, "B", 45, (False, "asked in vain"), lambda: None)
        said = revision(90, change(181, 1, 1, FALSE), None, standing={41: stands(FALSE, HELD, at=step(41))})
        history.append(2, [stored_revision(90, said)], lambda: None, [said])
        history.close_session(2, 77, {"id": STRANGE, "continued_by": None})
        await history.flush()
        await brought(history, url, bringing, 10)
        assert at_the_centre(url) == at_the_robot(tmp_path)
        history.append(2, [], lambda: None, (), [episode._replace(gone=True)])
        await history.flush()
        await brought(history, url, bringing)
        rows = at_the_robot(tmp_path)
        assert at_the_centre(url) == rows
        assert ("p", 900) not in [row[1:3] for row in rows["episodes"]]
        told = await brought(history, url, bringing)
        assert told.rows == 0
        bringing.close()


@pytest.mark.parametrize("seed", range(3))
async def test_by_small_chunks_and_with_ends_at_random_it_is_the_same(
    seed: int, postgres: Postgres, tmp_path: Path
) -> None:
    """Chunks of some rows; connections break, and what was committed is not always noted here."""
    url, chance = postgres.empty(), random.Random(seed)
    last, bringing = [0, 0, 0], Bringing()
    for _ in range(4):
        async with robot(tmp_path) as history:
            for _ in range(12):
                number = chance.randint(1, 3)
                if not last[number - 1]:
                    history.open_session(opened(number, f"s{number}"))
                first, last[number - 1] = last[number - 1] + 1, last[number - 1] + chance.randint(1, 40)
                steps = [step(p, violated=[0] * (p % 7 == 0)) for p in range(first, last[number - 1] + 1)]
                episode = Episode(chance.choice([1, 3]), 5, 9, 7, open=chance.random() < 0.5, final=True, count=first)
                kept = StoredEpisode("p", "publication", episode, None, gone=chance.random() < 0.3)
                history.append(number, steps, lambda: None, (), [kept])
                for p in chance.sample(range(1, last[number - 1] + 1), 2 if last[number - 1] > 1 else 1):
                    history.amend(number, "m", p, (True, str(chance.random())), lambda: None)
                await history.flush()
                noted = history.forwarding
                assert noted is not None
                for _ in range(chance.randint(0, 5)):
                    known = await noted.stands()
                    ask = Ask(os.fsencode(noted.path), url, ORIGIN, known.robot, known.seq, chance.randint(1, 30))
                    told = await asyncio.to_thread(bringing.bring, ask)
                    assert told.anew is None
                    if chance.random() < 0.6 and told.error is None:
                        await noted.note(told.seq, told.reached)
                    if chance.random() < 0.2:
                        postgres.kill_backends()
                    if chance.random() < 0.2:
                        bringing.close()
    async with robot(tmp_path) as history:
        bringing.close()
        await brought(history, url, bringing, 20)
        assert at_the_centre(url) == at_the_robot(tmp_path)
        bringing.close()


async def test_a_process_that_is_killed_again_and_again_brings_each_row_once(
    postgres: Postgres, tmp_path: Path
) -> None:
    url = postgres.empty()
    await fill(SqliteHistory(tmp_path))
    async with robot(tmp_path) as history:
        noted = history.forwarding
        assert noted is not None
        known = await noted.stands()
        ask = Ask(os.fsencode(noted.path), url, ORIGIN, known.robot, known.seq, 24)
        chance = random.Random(1)
        for _ in range(3):
            process = subprocess.Popen(
                [sys.executable, "-m", "oracle_server.history.forwarding.working"],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE,
            )  # fmt: skip
            assert process.stdin is not None
            assert process.stdout is not None
            for _ in range(chance.randint(1, 5)):
                send(process.stdin, ask)
                await asyncio.to_thread(receive, process.stdout)
            send(process.stdin, ask)
            process.send_signal(signal.SIGKILL)  # before it has read that, or within what follows
            process.communicate()
        bringing = Bringing()
        await brought(history, url, bringing, 24)
        bringing.close()
        assert at_the_centre(url) == at_the_robot(tmp_path)


async def test_a_new_session_never_gets_the_number_of_one_that_the_centre_has(
    postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, step(1))
        history.close_session(1, 1, {})
        await brought(history, url, bringing)
        await history.forget_session(1)
    async with robot(tmp_path) as history:
        assert await history.last_number() == 1
        history.open_session(opened(2, "one"))  # by the name of one that was deleted
        await add(history, step(1), session=2)
        await brought(history, url, bringing)
        bringing.close()
    centre = PostgresHistory(url)
    assert [await centre.extent(n) for n in (1, 2)] == [(1, 1), (1, 1)]
    assert await centre.session(f"one.2@{ORIGIN}") is not None
    await asyncio.to_thread(centre.close)


async def test_a_copy_that_went_on_by_itself_is_not_mixed_with_the_other_one(
    postgres: Postgres, tmp_path: Path
) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 4)))
        await brought(history, url, bringing)
    (tmp_path / "other").mkdir()
    with closing(sqlite3.connect(tmp_path / NAME)) as one, closing(sqlite3.connect(tmp_path / "other" / NAME)) as two:
        one.backup(two)
    async with robot(tmp_path) as history:
        await add(history, *(step(p) for p in range(4, 9)))
        await brought(history, url, bringing)
    bringing.close()
    async with robot(tmp_path / "other") as history:
        await add(history, *(msgspec.structs.replace(step(p), judged=7) for p in range(4, 20)))
        await brought(history, url, bringing)
        bringing.close()
    robots = {robot for robot, _ in names(url).values()}
    assert len(robots) == 2
    folders = {len(rows["steps"]): rows for rows in map(at_the_robot, (tmp_path, tmp_path / "other"))}
    for each in robots:
        there = at_the_centre(url, each)
        assert there["steps"] == folders[len(there["steps"])]["steps"]


@pytest.mark.parametrize(("version", "said"), [(VERSION - 1, "start the centre's"), (VERSION + 1, "start the robot's")])
def test_who_has_the_older_version_is_told(version: int, said: str, postgres: Postgres) -> None:
    url = postgres.empty()
    centre_module.Centre(url, ORIGIN, "one").close()
    postgres.do(f"UPDATE format SET version = {version}", url)
    with pytest.raises(HistoryError, match=f"the centre's history has format {version}, .* {said} server by the"):
        centre_module.Centre(url, ORIGIN, "one")


async def test_a_centre_of_an_older_version_of_this_format_takes_what_is_brought_once_its_server_is_newer(
    postgres: Postgres,
) -> None:
    url = postgres.empty()
    centre_module.Centre(url, ORIGIN, "one").close()
    postgres.do("ALTER TABLE forwarded DROP COLUMN opened, DROP COLUMN ended", url)
    with pytest.raises(HistoryError, match="made by an older version: start the centre's server by the version that"):
        centre_module.Centre(url, ORIGIN, "one")
    centre = PostgresHistory(url)
    await asyncio.to_thread(centre.close)
    centre_module.Centre(url, ORIGIN, "one").close()


def test_nothing_is_brought_where_the_centre_could_lose_it(postgres: Postgres) -> None:
    """As where a robot's role does not wait for commits: the robot would delete what a power cut takes there."""
    with pytest.raises(HistoryError, match="PostgreSQL has synchronous_commit = off"):
        centre_module.Centre(f"{postgres.empty()}%20-c%20synchronous_commit%3Doff", ORIGIN, "one")


async def test_what_a_centre_of_an_older_format_has_is_gone_on_with(postgres: Postgres, tmp_path: Path) -> None:
    url, bringing = postgres.empty(), Bringing()
    async with robot(tmp_path) as history:
        history.open_session(opened(1, "one"))
        await add(history, *(step(p) for p in range(1, 50)))
        await brought(history, url, bringing)
        bringing.close()
        postgres.do(
            "ALTER TABLE forwarded DROP COLUMN own, DROP COLUMN continued, DROP COLUMN opened, DROP COLUMN ended", url
        )
        postgres.do("DROP TABLE forgotten", url)
        postgres.do("UPDATE format SET version = 11", url)
        centre = PostgresHistory(url)
        await asyncio.to_thread(centre.close)
        await add(history, *(step(p) for p in range(50, 60)))
        history.close_session(1, 5, {"id": "one", "continued_by": None})
        await history.flush()
        await brought(history, url, bringing)
        bringing.close()
        assert at_the_centre(url) == at_the_robot(tmp_path)
    assert postgres.do("SELECT opened, ended > 0 FROM forwarded", url) == [(1001, True)]


def successors(postgres: Postgres, url: str) -> dict[str, str | None]:
    """Of each session that is closed at the centre, which one goes on with it."""
    states = [json.loads(str(state)) for (state,) in postgres.do("SELECT state FROM sessions", url) if state]
    return {state["id"]: state["continued_by"] for state in states}


async def test_a_session_is_continued_by_one_of_the_same_disk(postgres: Postgres, tmp_path: Path) -> None:
    """Also where another disk had sessions of their names before, and where the next one comes later."""
    url, bringing = postgres.empty(), Bringing()
    for disk, together in (("first", True), ("second", False)):
        (tmp_path / disk).mkdir()
        async with robot(tmp_path / disk) as history:
            history.open_session(opened(1, "s"))
            history.close_session(1, 6, {"id": "s", "continued_by": "s2"})
            if not together:
                await history.flush()
                await brought(history, url, bringing)
                assert successors(postgres, url)[f"s.1@{ORIGIN}"] is None, "it is not there yet"
            history.open_session(opened(2, "s2"))
            history.close_session(2, 7, {"id": "s2", "continued_by": None})
            await history.flush()
            await brought(history, url, bringing)
            bringing.close()
    assert successors(postgres, url) == {
        f"s@{ORIGIN}": f"s2@{ORIGIN}", f"s2@{ORIGIN}": None, f"s.1@{ORIGIN}": f"s2.2@{ORIGIN}", f"s2.2@{ORIGIN}": None,
    }  # fmt: skip


async def test_episodes_of_steps_are_found_without_a_look_at_all_others(tmp_path: Path) -> None:
    """A session that lives long has many more of them than a chunk has rows, and each chunk asks."""
    async with robot(tmp_path) as history:
        history.open_session(opened())
        await history.flush()
    with closing(sqlite3.connect(tmp_path / NAME)) as database:
        plan = database.execute(f"EXPLAIN QUERY PLAN {_BEGUN_IN}", (1, 1, 9)).fetchall()
    assert any("session=? AND property=? AND first>? AND first<?" in row[3] for row in plan), plan
