"""How many violations there were is told by servers that read the history alone, also of what is deleted."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from oracle_server.core.episode import Episode
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.forwarding.working import Bringing
from oracle_server.history.port import History
from oracle_server.history.postgres.history import PostgresHistory
from oracle_server.history.postgres.store import Node
from oracle_server.history.sqlite.beside import SqliteBeside
from oracle_server.history.sqlite.history import SqliteHistory
from tests.history.forwarded import ORIGIN, brought, robot
from tests.history.making import PROPERTIES, opened, step
from tests.postgres import Postgres

WIDTH = len(PROPERTIES)
ALL = {"p": (12, 1), "q": (3, 6)}
"""How often each property was violated, and where first."""


def ended(position: int, name: str = "p", count: int = 3) -> StoredEpisode:
    """An episode of one row."""
    n = WIDTH * (position - 1) + 1 + PROPERTIES.index(name)
    return StoredEpisode(name, "publication", Episode(n, 5, n, 7, open=False, final=False, count=count), "why")


OF_ARRIVAL = ended(2, count=100)._replace(order="arrival")
"""The order that decides is the other one."""


async def fill(history: History) -> None:
    """A session of 40 rows, with violations at some of them."""
    history.open_session(opened())
    episodes = [ended(1), OF_ARRIVAL, ended(3), ended(3, "q"), ended(20), ended(39)]
    history.append(1, [step(p) for p in range(1, 41)], lambda: None, (), episodes)
    await history.flush()


async def told(reading: History) -> dict[str, tuple[int, int | None]]:
    """What a server tells that only reads."""
    (other,) = await reading.open_elsewhere()
    return {stands.property: (stands.violations, stands.first_violation) for stands in other.properties}


@asynccontextmanager
async def two(backend: str, folder: Path, postgres: Postgres) -> AsyncIterator[Sequence[History]]:
    """A history as its server has it, and as another one does."""
    url = postgres.empty()
    made: list[History] = []
    if backend == "sqlite":
        made.append(SqliteHistory(folder))
        made.append(SqliteBeside(folder))
    else:
        made += [await asyncio.to_thread(PostgresHistory, url, node=Node(name)) for name in "ab"]
    for history in made:
        history.start(asyncio.get_running_loop())
    yield made
    for history in made:
        await asyncio.to_thread(history.close)


@pytest.mark.parametrize("backend", ["sqlite", "postgres"])
async def test_deadlines_are_no_steps_to_who_only_reads(backend: str, tmp_path: Path, postgres: Postgres) -> None:
    async with two(backend, tmp_path, postgres) as (own, other):
        own.open_session(opened())
        own.append(1, [step(1), step(2, kind="tick"), step(3, number=2), step(4, kind="tick")], lambda: None)
        await own.flush()
        assert [each.steps for each in await other.open_elsewhere()] == [2]


@pytest.mark.parametrize("backend", ["sqlite", "postgres"])
async def test_what_is_deleted_is_counted_on(backend: str, tmp_path: Path, postgres: Postgres) -> None:
    async with two(backend, tmp_path, postgres) as (own, other):
        await fill(own)
        assert await told(other) == ALL
        for before in (4, 4, 30, 31):
            await own.forget_steps(1, before)
            assert await told(other) == ALL
        own.append(1, [], lambda: None, (), [ended(3), ended(20)])  # a server that goes on with a session keeps it so
        await own.flush()
        assert await told(other) == ALL
        await own.forget_steps(1, 33)
        assert await told(other) == ALL
        own.append(1, [step(41)], lambda: None, (), [ended(41, "q", count=1)])
        await own.flush()
        assert await told(other) == ALL | {"q": (4, 6)}
        await own.forget_session(1)
        own.open_session(opened())
        own.append(1, [step(1)], lambda: None)
        await own.flush()
        assert await told(other) == {"p": (0, None), "q": (0, None)}


async def test_a_centre_counts_what_was_deleted_on_either_side(postgres: Postgres, tmp_path: Path) -> None:
    url, bringing = postgres.empty(), Bringing()
    centre = PostgresHistory(url)
    centre.start(asyncio.get_running_loop())
    async with robot(tmp_path) as history:
        await fill(history)
        await brought(history, url, bringing)
        assert await told(centre) == ALL
        await centre.forget_steps(1, 30)
        assert await told(centre) == ALL
        await history.forget_steps(1, 10)
        await brought(history, url, bringing)
        assert await told(centre) == ALL, "the centre has deleted more than the robot"
        more = [ended(41, count=5), ended(45, count=1)]
        history.append(1, [step(p) for p in range(41, 61)], lambda: None, (), more)
        await history.flush()
        await history.forget_steps(1, 50)
        await brought(history, url, bringing)
        bringing.close()
        assert await told(centre) == {"p": (18, 1), "q": (3, 6)}, "what the disk had no room for was never brought"
    assert await centre.session(f"s@{ORIGIN}") is not None
    await asyncio.to_thread(centre.close)
