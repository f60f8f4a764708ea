"""The lives of sessions: live, left, closed, and begun anew by the same name."""

from __future__ import annotations

import asyncio
import json
import signal
import time
from typing import Any

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import Server, failed, run
from tests.whole.test_sessions import refused


async def closed(server: Server, session: str) -> dict[str, Any]:
    state: dict[str, Any] = await server.until(
        lambda: server.get(f"sessions/{session}"), lambda found: found["status"] == "closed"
    )
    return state


async def test_a_session_that_is_left_is_closed_and_its_name_begins_anew(start: Starts) -> None:
    server = start(ORACLE_RESUME_WITHIN="0.05")
    async with attached(server, session="s", spec="brief") as monitor:
        state = server.get("sessions/s")
        assert (state["live"], state["idle"], state["kind"], state["run"]) == (True, False, "robot", 1)
        await monitor.send(make_event(1, data={"v": 11}))
        await monitor.acked(1)
        monitor.vanish()
    state = await closed(server, "s")
    assert (state["closed_because"], state["live"]) == ("no monitor for 50ms (`close:` of its spec)", False)
    assert state["counters"]["steps"] == 1
    told = await refused(server, session="s", spec="brief")
    assert (told["code"], told["session"]) == ("session_ended", "s.run2")
    async with attached(server, session="s.run2", spec="brief") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
        assert (await refused(server, monitor="m2", session="s"))["session"] == "s.run2"
        assert server.get("sessions/s.run2")["run"] == 2
        server.stop(signal.SIGKILL)
    server = start(ORACLE_RESUME_WITHIN="0.05")
    assert (await closed(server, "s.run2"))["closed_because"] == state["closed_because"]
    assert [r["outcome"] for r in server.records("s.run2")] == ["currently_true"]


async def test_a_session_goes_on_as_another_run_where_a_monitors_clock_is_set_back(
    server: Server, session: str
) -> None:
    """All that came was late, and judged at the time that had been reached, until the clock was there again."""
    now = time.time_ns()
    async with (
        attached(server, "m1", session=session, spec="pair", streams=["/a"]) as monitor,
        attached(server, "m2", session=session, streams=["/b"]) as other,
    ):
        await monitor.send(make_event(1, stamp=now, data={"v": 1}), wall_clock(now))
        await monitor.send(wall_clock(now - 10**9), make_event(2, stamp=now, data={"v": 1}))
        await monitor.send(wall_clock(now - 1800 * 10**9), make_event(3, stamp=now - 1800 * 10**9, data={"v": 1}))
        for one in (monitor, other):
            frames, _ = await one.closed()
            assert (frames[-1]["code"], frames[-1]["session"]) == ("session_ended", f"{session}.run2")
    state = server.get(f"sessions/{session}")
    assert (state["closed_because"], state["continued_by"]) == ("the machine's clock was set back", f"{session}.run2")
    assert [r["seq"] for r in server.records(session, property="a_is_small")] == [1, 2]
    told = await refused(server, monitor="m3", session=session)
    assert (told["session"], "the machine's clock was set back" in told["message"]) == (f"{session}.run2", True)


def wall_clock(at: int) -> dict[str, object]:
    return {"type": "clock", "stamps": [{"stream": "/a", "kind": "topic", "stamp": at}]}


async def test_a_session_is_closed_by_the_command_line(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
        ended = await asyncio.to_thread(run, "close", session, "--url", server.url)
        assert (ended.returncode, ended.stderr) == (0, "")
        assert ended.stdout.splitlines()[1].split()[:3] == [session, "single", "closed"]
    again = await asyncio.to_thread(run, "close", session, "--json", "--url", server.url)
    assert json.loads(again.stdout)["items"] == [server.get(f"sessions/{session}")]
    line = await asyncio.to_thread(failed, "close", "nowhere", "--url", server.url)
    assert "no session 'nowhere' is known" in line
    assert (await refused(server, session=session))["code"] == "session_closed"
    assert (await refused(server, session=session, instance="m1-2"))["session"] == f"{session}.run2"
