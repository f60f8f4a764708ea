"""A short campaign; a long one is run by hand."""

from __future__ import annotations

import asyncio
import os
import random
from pathlib import Path

import pytest

from tests.chaos.served import PATIENCE, Served
from tests.fuzz.campaign import leg, prepare, restarted, wrong_with
from tests.fuzz.frames import Event, Frame, Writer
from tests.fuzz.monitor import Monitor, Told

FRAMES = 10_000


@pytest.fixture
def seed() -> int:
    seed = int(os.environ.get("TEST_SEED") or random.randrange(2**32))
    print(f"TEST_SEED={seed}")
    return seed


async def test_whatever_monitors_say_what_is_acked_is_judged_once_and_others_are_judged_right(
    seed: int, tmp_path: Path
) -> None:
    async with asyncio.timeout(10 * PATIENCE), Served(prepare(tmp_path / "specs"), tmp_path / "data") as served:
        count = await leg(served, 0, FRAMES, seed)
        again = await restarted(served, seed)
        assert await served.stop() == 0
    assert count.wrong == []
    assert again.wrong == []
    assert count.frames >= FRAMES
    assert 2 * count.judged >= count.frames
    assert 10 * count.asked >= count.frames


def event(seq: int) -> Event:
    return Event(seq, "/a", "topic", "{}")


def record(n: int, **more: object) -> Frame:
    made = {"n": n, "monitor": "m1", "seq": n, "property": "p", "order": "publication", "stream": "/a", "kind": "topic"}
    return made | {"outcome": "true", "decision": "allow"} | more


def test_the_campaign_sees_what_is_wrong() -> None:
    writer = Writer(random.Random(0), [("/a", "topic")])
    told = Told()
    monitor = Monitor("", "m1", "s", "single", "wall", writer, told, lambda: None)
    monitor.numbers.begin(1)
    for seq in (1, 2, 3, 5):
        monitor.numbers.add(event(seq))
    monitor.numbers.acked = 5
    told.decisions["m1", 2] = {"decision": "allow", "verdicts": {"p": "true"}}
    told.violations[3] = record(3) | {"type": "violation"}
    sound = [record(1), record(2), record(3), record(4, seq=5)]

    def wrong(records: list[Frame], streamed: list[Frame] | None = None) -> bool:
        return bool(wrong_with(records, records if streamed is None else streamed, [monitor], told))

    assert not wrong(sound)
    assert wrong(sound[:3])
    assert wrong(sound, sound[:3])
    assert wrong([*sound, record(5)])
    assert wrong([*sound, record(5, seq=4)])
    assert wrong([*sound[:3], record(5, seq=5)])
    assert wrong([*sound[:3], record(4, seq=5, stream="/b")])
    assert wrong([sound[0], record(2, decision="deny"), *sound[2:]])
    assert wrong([sound[0], record(2, outcome="false"), *sound[2:]])
    assert wrong([*sound[:2], record(3, outcome="false"), sound[3]])
    monitor.numbers.refused.add(3)
    assert wrong(sound)


def test_numbers_that_were_jumped_over_may_be_missing() -> None:
    numbers = Monitor("", "m1", "s", "single", "wall", Writer(random.Random(0), []), Told(), lambda: None).numbers
    numbers.begin(1)
    for seq in (1, 4, 2):
        numbers.add(event(seq))
    numbers.acked = 4
    assert numbers.must_be_judged() == {1, 4}
    numbers.begin(3)
    numbers.add(event(3))
    assert numbers.must_be_judged() == {1, 4}
    numbers.begin(5)
    numbers.add(event(5))
    assert numbers.must_be_judged() == {1, 4}
    numbers.acked = 5
    assert numbers.must_be_judged() == {1, 4, 5}
