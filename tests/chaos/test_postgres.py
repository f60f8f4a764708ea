"""A server over PostgreSQL, to which and to whose database something happens while a trace comes in.

Nothing acked is lost, nothing is there twice, and what monitors were told is what is recorded.
"""

from __future__ import annotations

import asyncio
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.chaos.campaign import judged
from tests.chaos.link import Frame
from tests.chaos.runs import (
    SESSION,
    TRIO,
    assert_same,
    assert_sound,
    specs,
    stream_through,
    told,
    uninterrupted,
    void,
)
from tests.chaos.served import Served, reviving
from tests.postgres import Postgres, Relay

LEASE = 1.0
"""Seconds of the server's lease."""
QUICK = "from oracle_server.history.postgres import store; store.PATIENCE = 2.0"
"""A connection that is silent is soon given up."""


def served_over(url: str, folder: Path) -> Served:
    more = {"history": url, "lease": str(LEASE), "resume_within": "600"}
    return Served(specs(TRIO, folder), folder / "data", prelude=QUICK, **more)


def points(trace: list[Frame], chance: random.Random, count: int) -> list[int]:
    return sorted(chance.sample(range(len(trace) // 20, told(trace) * 2 // 3), count))


async def test_a_server_is_killed(
    postgres: Postgres, trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    struck = points(trace, chance, 5)
    async with served_over(postgres.empty(), tmp_path) as served:
        async with reviving(served):
            links = await stream_through(served, TRIO, trace, chance, struck, lambda _: served.kill())
        assert served.starts == len(struck) + 1
        records = await served.records(SESSION)
        assert await served.stop() == 0
        await served.start()
        assert await served.records(SESSION) == records
    assert_sound(records, links)
    assert_same(records, await uninterrupted(TRIO, trace, tmp_path, known))


async def _silence(relay: Relay) -> None:
    relay.fall_silent()
    await asyncio.sleep(3 * LEASE)  # waits for nothing: it is how long nobody hears anything
    relay.speak()


def _restart(postgres: Postgres) -> None:
    postgres.stop("immediate")
    postgres.start()


async def _freeze(served: Served) -> None:
    served.freeze()
    await asyncio.sleep(1.5 * LEASE)  # likewise
    served.thaw()


@pytest.mark.parametrize(
    "fault", ["connections end", "PostgreSQL restarts", "the network is silent", "a server stands"]
)
async def test_what_a_server_needs_fails(
    fault: str,
    postgres: Postgres,
    relay: Relay,
    trace: list[Frame],
    tmp_path: Path,
    chance: random.Random,
    known: dict[str, list[Frame]],
) -> None:
    one_by_one = asyncio.Lock()
    async with served_over(postgres.empty(relay), tmp_path) as served, asyncio.TaskGroup() as tasks:
        faults: dict[str, Callable[[], object]] = {
            "connections end": lambda: asyncio.to_thread(postgres.kill_backends),
            "PostgreSQL restarts": lambda: asyncio.to_thread(_restart, postgres),
            "the network is silent": lambda: _silence(relay),
            "a server stands": lambda: _freeze(served),
        }

        async def strike() -> None:
            async with one_by_one:
                await faults[fault]()  # type: ignore[misc]

        links = await stream_through(
            served, TRIO, trace, chance, points(trace, chance, 4), lambda _: void(tasks.create_task(strike()))
        )
        async with one_by_one:
            records = await served.records(SESSION)
        assert served.starts == 1
        assert not any("Traceback" in line["event"] or "exception" in line for line in served.log)
    decisions = {(link.attach["monitor"], s): f["decision"] for link in links for s, f in link.decisions.items()}
    count = judged(records, await uninterrupted(TRIO, trace, tmp_path, known), decisions, spoilt=True)
    assert (count.lost, count.twice, count.different) == (0, 0, 0)
