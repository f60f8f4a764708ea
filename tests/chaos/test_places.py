"""Whom the order waits for, after the server was killed: those that were attached, and nobody else."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack
from pathlib import Path

import pytest
from websockets.asyncio.client import ClientConnection

from tests.chaos.by_hand import attached, event, say, until_acked
from tests.chaos.served import PATIENCE, Served

SPEC = """
id: patient
ordering: {by: publication, max_delay: none}
streams:
  - topic: /t
    signals: {ok: msg.ok}
properties:
  - {id: fine, formula: '{ok: true}'}
"""
OK = {"ok": True}


@pytest.fixture
async def served(tmp_path: Path) -> AsyncIterator[Served]:
    """A server that keeps the place of a lost monitor for longer than any test takes."""
    folder = tmp_path / "specs"
    folder.mkdir()
    (folder / "patient.yaml").write_text(SPEC)
    async with Served(folder, tmp_path / "data", resume_within="3600") as server:
        yield server


async def test_who_came_back_is_waited_for(served: Served) -> None:
    async with asyncio.timeout(PATIENCE):
        async with attached(served, "patient", "s", "a") as a, attached(served, "patient", "s", "b") as b:
            await say(a, [event(1, OK)])
            await say(b, [event(1, OK)])
            await until_acked(a, 1)
            await until_acked(b, 1)
            await restart(served)
        async with attached(served, "patient", "s", "a") as a:
            await say(a, [event(2, OK)])
            await until_read(a)
            assert await steps_and_held(served) == (2, 1)
            async with attached(served, "patient", "s", "b") as b:
                await say(b, [event(2, OK)])
                await until_acked(a, 2)


async def test_who_had_said_nothing_is_waited_for(served: Served) -> None:
    async with asyncio.timeout(PATIENCE):
        async with attached(served, "patient", "s", "a") as a:
            await say(a, [event(1, OK)])
            await until_acked(a, 1)
            async with attached(served, "patient", "s", "silent"):
                await restart(served)
        async with attached(served, "patient", "s", "a") as a:
            await say(a, [event(2, OK)])
            await until_read(a)
            assert await steps_and_held(served) == (1, 1)


async def test_who_had_detached_is_not_waited_for(served: Served) -> None:
    async with asyncio.timeout(PATIENCE):
        async with attached(served, "patient", "s", "a") as a, attached(served, "patient", "s", "b") as b:
            await say(a, [event(1, OK)])
            await say(b, [event(1, OK), {"type": "detach"}])
            await until_acked(a, 1)
            while json.loads(await b.recv())["type"] != "detached":
                pass
            await restart(served)
        async with attached(served, "patient", "s", "a") as a:
            await say(a, [event(2, OK)])
            await until_read(a)
            assert await steps_and_held(served) == (3, 0)


async def test_nobody_is_expelled_before_the_server_accepts_work(tmp_path: Path) -> None:
    """A restart takes longer than a place is kept here: nobody could have come back in time."""
    folder = tmp_path / "specs"
    folder.mkdir()
    (folder / "patient.yaml").write_text(SPEC)
    gone = "monitor did not reconnect"
    async with asyncio.timeout(PATIENCE), Served(folder, tmp_path / "data", resume_within="0.0001") as server:
        names = [f"s{i}" for i in range(5)]
        async with AsyncExitStack() as stack:
            for name in names:
                a = await stack.enter_async_context(attached(server, "patient", name, "a"))
                await say(a, [event(1, OK)])
                await until_acked(a, 1)
            await restart(server)
        await server.said(gone, len(names))
        told = [line["event"] for line in server.log]
        assert "accepting work" not in told[told.index(gone) :]


async def restart(served: Served) -> None:
    """Kill the server, and start it again."""
    served.kill()
    await served.start()


async def until_read(socket: ClientConnection) -> None:
    """Wait until the server has taken in all that was sent: it answers what comes after it."""
    await socket.send("no frame")
    while json.loads(await socket.recv())["type"] != "error":
        pass


async def steps_and_held(served: Served) -> tuple[int, int]:
    """How many events the session has judged, and how many wait for their turn."""
    counters = (await served.get("sessions/s"))["counters"]
    return counters["steps"], counters["held"]
