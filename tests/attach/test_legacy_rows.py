"""A message whose elements are judged one by one, in turns: its monitor is told what all of them came to."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any, cast

import pytest
from starlette.websockets import WebSocket

from oracle_server.attach.rosmonitoring import LegacyConnection
from oracle_server.history.memory import MemoryHistory
from tests.attach.test_resting import Socket
from tests.processes import PATIENCE
from tests.sessions.making import registry

SPEC = """
id: joints
streams:
  - {topic: /joints, each: msg.list, signals: {k: item}}
properties:
  - {id: good, formula: 'not {k: bad}'}
"""


class Silent(Socket):
    """A WebSocket of ROSMonitoring's monitors, which agree on no protocol."""

    async def accept(self, _protocol: str | None = None) -> None: ...

    async def tells(self, items: list[str]) -> Any:
        self.says({"topic": "joints", "time": 1, "list": items})
        async with asyncio.timeout(PATIENCE):
            return await self.sent.get()


@pytest.mark.parametrize("bad", [None, 0, 1, 255])
async def test_a_reply_is_of_all_rows(tmp_path: Path, bad: int | None) -> None:
    history, socket = MemoryHistory(), Silent()
    sessions = registry(history, tmp_path, SPEC)
    session = await sessions.create("joints", None, private=True, by="arrival")
    session.core.divide(lambda: True)  # one row a turn
    serving = asyncio.create_task(LegacyConnection(cast("WebSocket", socket), session).serve())
    for _ in range(3):
        reply = await socket.tells(["bad" if n == bad else "good" for n in range(256)])
        assert reply["verdict"] == ("currently_true" if bad is None else "currently_false"), json.dumps(reply)[:200]
        assert ("spec" in reply) is (bad is not None)
    assert session.core.judges["arrival"].counters.steps == 3 * 256
    socket.leaves()
    async with asyncio.timeout(PATIENCE):
        await serving
    history.close()
