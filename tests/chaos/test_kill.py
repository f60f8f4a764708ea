"""Nothing acked is lost, nothing is judged twice, and no verdict changes, whatever becomes of the server's process.

The points at which it is killed are counted in what monitors have been told, never in time. TEST_SEED repeats a run.
"""

from __future__ import annotations

import asyncio
import random
from contextlib import suppress
from pathlib import Path

import pytest

from tests.chaos.link import LOST, Frame, Link
from tests.chaos.runs import (
    ALONE,
    PAIR,
    SESSION,
    Layout,
    assert_same,
    assert_sound,
    each_layout,
    specs,
    stream_through,
    told,
    uninterrupted,
    void,
)
from tests.chaos.served import Served, reviving

KILLS = 5


@pytest.mark.parametrize(
    ("layout", "durability"),
    [(ALONE, "full"), (PAIR, "full"), (ALONE, "normal")],
    ids=["one monitor", "two monitors", "durability normal"],
)
async def test_kills_in_a_row(
    layout: Layout,
    durability: str,
    trace: list[Frame],
    tmp_path: Path,
    chance: random.Random,
    known: dict[str, list[Frame]],
) -> None:
    first = len(trace) // 20  # by then each monitor has something in the history
    points = sorted(chance.sample(range(first, told(trace) * 2 // 3), KILLS))
    async with Served(specs(layout, tmp_path), tmp_path / "data", durability=durability) as served:
        async with reviving(served):
            links = await stream_through(served, layout, trace, chance, points, lambda _: served.kill())
        assert served.starts == KILLS + 1
        records = await served.records(SESSION)
        assert await served.stop() == 0
        await served.start()
        assert await served.records(SESSION) == records
        assert await served.stop() == 0
        assert not served.complaints
    assert_sound(records, links)
    assert_same(records, await uninterrupted(layout, trace, tmp_path, known))


@each_layout
async def test_frozen_and_thawed(
    layout: Layout, trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    points = sorted(chance.sample(range(told(trace) * 2 // 3), 5))
    async with Served(specs(layout, tmp_path), tmp_path / "data") as served, asyncio.TaskGroup() as freezes:

        async def freeze() -> None:
            served.freeze()
            await asyncio.sleep(0.4)  # waits for nothing: it is how long the server is frozen, longer than max_delay
            served.thaw()

        links = await stream_through(
            served, layout, trace, chance, points, lambda _: void(freezes.create_task(freeze()))
        )
        records = await served.records(SESSION)
        assert served.starts == 1
        assert not served.complaints
    assert_sound(records, links)
    assert_same(records, await uninterrupted(layout, trace, tmp_path, known))


@each_layout
async def test_connections_cut(
    layout: Layout, trace: list[Frame], tmp_path: Path, chance: random.Random, known: dict[str, list[Frame]]
) -> None:
    points = sorted(chance.sample(range(told(trace) * 2 // 3), 30))
    async with Served(specs(layout, tmp_path), tmp_path / "data") as served, asyncio.TaskGroup() as overtakings:

        async def overtake(link: Link) -> None:
            with suppress(*LOST):
                await link.overtake()

        def strike(links: list[Link]) -> None:
            link = chance.choice(links)
            if chance.random() < 0.7:
                link.cut()
            else:
                overtakings.create_task(overtake(link))

        links = await stream_through(served, layout, trace, chance, points, strike)
        records = await served.records(SESSION)
        assert served.starts == 1
        assert sum(link.attaches for link in links) > len(links)
        assert not served.complaints
    assert_sound(records, links)
    assert_same(records, await uninterrupted(layout, trace, tmp_path, known))
