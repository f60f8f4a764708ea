"""A session of many monitors: who asks for its state keeps nobody waiting."""

from __future__ import annotations

import asyncio
from pathlib import Path

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.status import session_state
from tests.sessions.making import Kept, attach, registry

SPEC = """
id: many
streams: [{topic: /a, signals: {v: msg.v}}, {topic: /b, signals: {w: msg.w}}]
properties: [{id: p, formula: '{v > 0} -> once {w > 0}'}]
"""


async def test_its_state_is_made_in_turns_while_others_come_and_go(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, SPEC)
    first = None
    for number in range(1_000):
        live, monitor = await sessions.attach(attach("s", "many", monitor=f"m{number}"), Kept())
        first = first or monitor
    assert first is not None
    asked = asyncio.ensure_future(sessions.state("s"))
    turns = 0
    while not asked.done():
        await asyncio.sleep(0)
        turns += 1
        if turns == 2:
            live.detach(first)
            await sessions.attach(attach("s", "many", monitor="later"), Kept())
    state = await asked
    assert turns > 10, "3,000 rows, a few hundred at once"
    assert state is not None
    assert len(state["monitors"]) == 1_000
    assert 1_998 <= len(state["streams"]) <= 2_002
    now = await sessions.state("s")
    assert now is not None
    whole = session_state(live, 0)
    assert [row["name"] for row in now["monitors"]] == [row["name"] for row in whole["monitors"]]
    assert len(now["streams"]) == len(whole["streams"]) == 2_000
