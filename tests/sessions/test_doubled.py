"""Messages that several monitors hear of one publisher: that they are judged twice is told."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.status import session_state
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event, registry

GID = "010f6b1f2a1c3d4e0000000000001203"
SPEC = """
id: scans
streams:
  - {topic: /scan, type: sensor_msgs/LaserScan, signals: {near: msg.near}}
  - {topic: /mode, type: std_msgs/String, signals: {mode: msg.mode}, hold: [mode]}
properties:
  - {id: often, pattern: /scan at least 10 Hz over 2s}
  - {id: manual, formula: '{topic: /mode} -> {mode: manual}'}
"""


@pytest.fixture(autouse=True)
async def within() -> AsyncIterator[None]:
    async with asyncio.timeout(PATIENCE):
        yield


def told(live: LiveSession) -> dict[str, list[str]]:
    return {row["id"]: row["caveats"] for row in session_state(live, live.clock.now())["properties"]}


def say(live: LiveSession, monitor: Monitor, seq: int, stream: str, source: str) -> None:
    made = event(seq, stream, near=1.0, mode="manual")
    live.ingest(monitor, made.model_copy(update={"source": source, "stamp": live.clock.now()}))


async def test_that_two_monitors_hear_one_publisher_is_told(tmp_path: Path) -> None:
    sessions = registry(MemoryHistory(), tmp_path, SPEC)
    live, first = await sessions.attach(attach("s", "scans", monitor="one"), Kept())
    _, second = await sessions.attach(attach("s", "scans", monitor="two"), Kept())
    say(live, first, 1, "/scan", GID)
    say(live, second, 1, "/scan", GID.replace("f", "e"))
    assert told(live) == {"often": [], "manual": []}
    say(live, second, 2, "/scan", GID)
    text = "one and two hear one publisher of /scan, whose messages are judged twice: "
    (caveat,) = told(live)["often"]
    assert caveat.startswith(text)
    assert told(live)["manual"] == []
    live.detach(second)
    assert told(live)["often"] == []


@pytest.mark.parametrize(
    ("stream", "source"), [("/mode", GID), ("/scan", "/driver"), ("/scan", "")], ids=["held", "ROS 1", "not told"]
)
async def test_what_may_be_two_robots_own_is_not_told(stream: str, source: str, tmp_path: Path) -> None:
    """What is held of a shared topic each monitor has for itself; nodes of two robots' ROS 1 may have one name."""
    sessions = registry(MemoryHistory(), tmp_path, SPEC)
    live, first = await sessions.attach(attach("s", "scans", monitor="one"), Kept())
    _, second = await sessions.attach(attach("s", "scans", monitor="two"), Kept())
    say(live, first, 1, stream, source)
    say(live, second, 1, stream, source)
    assert told(live) == {"often": [], "manual": []}
