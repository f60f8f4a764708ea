"""A deadline of one property explains the others as they stood at the last step."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from oracle_server.review.explanation import explained
from oracle_server.wire.incoming import EventMessage
from tests.processes import PATIENCE
from tests.sessions.making import Kept, Standing, attach, registry

SPEC = """
id: spec
ordering: {max_delay: 20ms, late: LATE}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b}
properties:
  - {id: here, time: seconds, formula: 'once[:1h]{topic: "/b"}'}
  - {id: calm, time: seconds, formula: 'not once[:10ms] {v > 5}'}
  - {id: same, time: seconds, formula: '{topic: "/b"} or once[:1h] {v > 5}'}
"""
WIDTH = 3


async def ticks(history: MemoryHistory, count: int) -> list[StoredStep]:
    """The deadlines that were told, once there are so many."""
    async with asyncio.timeout(PATIENCE):
        while True:
            rows = [row async for page in history.steps(1, 0) for row in page if row.is_tick]
            if len(rows) >= count:
                return rows
            await asyncio.sleep(0.01)


@pytest.mark.parametrize("late", ["judge", "revise"])
async def test_what_no_deadline_of_its_own_changed_is_explained_by_the_last_step(tmp_path: Path, late: str) -> None:
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path / "specs", SPEC.replace("LATE", late), clock=clock)
    live, monitor = await sessions.attach(attach("s", "spec"), Kept())
    live.ingest(monitor, EventMessage(seq=1, stream="/a", data={"v": 0}))
    live.ingest(monitor, EventMessage(seq=2, stream="/b", data={}))
    live.ingest(monitor, EventMessage(seq=3, stream="/a", data={"v": 9}))
    clock.time += 10**9  # not before: a machine that stands still would have the deadline come first
    *_, tick = await ticks(history, 1)
    assert [*tick.outcomes] == ["currently_true"] * WIDTH
    texts = []
    for index in range(WIDTH):
        record = await explained(history, 1, (tick.position - 1) * WIDTH + index + 1)
        assert record is not None
        assert record["explanation"] is not None
        texts.append(record["explanation"]["text"])
    here, calm, same = texts
    assert "held at step 2 (" in here
    assert "none in the last 10ms; last at step 3 (" in calm
    assert "holds at step 3 (" in same
