"""What the order of a session releases at once is judged in turns, between which other sessions are judged."""

from __future__ import annotations

import asyncio
from itertools import pairwise
from pathlib import Path

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.shares import FREE, Shares
from oracle_server.wire.incoming import EventMessage
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, registry

ORDERED = """
id: ordered
ordering: {by: publication, max_delay: 600s}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - id: p
    formula: 'not {v > 1000}'
"""
HELD = 40


async def test_what_is_released_at_once_is_judged_in_turns(tmp_path: Path) -> None:
    spent = 0.0

    def look() -> float:
        """Each look finds that a turn's time was spent."""
        nonlocal spent
        spent += 2 * FREE
        return spent

    history = MemoryHistory()
    sessions = registry(history, tmp_path, ORDERED, shares=Shares(lambda: 0.0, look))
    outbox = Kept()
    session, monitor = await sessions.attach(attach("s", "ordered"), outbox)
    counters = session.core.judges["publication"].counters
    for seq in range(1, HELD + 1):
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    assert counters.steps == 0
    session.share.run(session.ingest, monitor, EventMessage(seq=HELD + 1, stream="/b", stamp=HELD, data={"v": 0}))
    steps = [counters.steps]
    async with asyncio.timeout(PATIENCE):
        while counters.steps <= HELD:
            await asyncio.sleep(0)
            steps.append(counters.steps)
    assert max(after - before for before, after in pairwise([0, *steps])) <= 2
    assert session.core.buffer.due is None
    assert await sessions.closed_within(session, PATIENCE)
    history.close()
