"""Who held an event up: which stream of which monitor, in the history, over HTTP and on the command line."""

from __future__ import annotations

import signal
from typing import Any

from oracle_server.cli.reasons import explanation_text
from tests.whole.client import Monitor, attached, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import Server

ARM = [{"monitor": "arm", "stream": "/b", "kind": "topic"}]


async def allowed_once_heard(server: Server, base: Monitor, arm: Monitor, seq: int, at: float) -> None:
    """The base asks of what waits for the arm's stream, and the arm tells of it."""
    held = len(server.records("s")) // 2
    await base.send(make_event(seq, "/a", at=at, data={"v": 11}))
    await server.holds("s", 1)
    assert len(server.records("s")) // 2 == held
    await arm.send(make_clock("/b", at + 1))
    await base.acked(seq)


def told(server: Server) -> dict[int, Any]:
    """What each event waited for, by its number: as verdicts, and as events, say."""
    records = {r["seq"]: r.get("waited", []) for r in server.records("s", property="a_is_small")}
    assert {i["seq"]: i["waited"] for i in server.get("sessions/s/sequence")["items"]} == records
    return records


async def test_the_stream_of_the_other_monitor_is_told_also_after_a_restart(start: Starts) -> None:
    server = start()
    async with (
        attached(server, "base", session="s", spec="slow", streams=["/a"]) as base,
        attached(server, "arm", session="s", streams=["/b"]) as arm,
    ):
        await allowed_once_heard(server, base, arm, 1, 10)
        await arm.send(make_clock("/b", 50))
        await base.send(make_event(2, "/a", at=20, data={"v": 1}))
        await base.acked(2)
        assert told(server) == {1: ARM, 2: []}
        server.process.send(signal.SIGKILL)
        await base.closed()
    server.end()
    server = start()
    assert told(server) == {1: ARM, 2: []}
    async with (
        attached(server, "base", session="s", streams=["/a"]) as base,
        attached(server, "arm", session="s", streams=["/b"]) as arm,
    ):
        await allowed_once_heard(server, base, arm, 3, 70)
        await base.send(make_event(4, "/a", at=80, data={"v": 1}))
        await server.holds("s", 1)
        await arm.detach()
        await base.acked(4)
    assert told(server) == {1: ARM, 2: [], 3: ARM, 4: ARM}
    explained = server.get("sessions/s/verdicts/2/explanation")
    assert explained["waited"] == ARM
    waited = "it waited for /b of arm, and went on once nothing older could come from there"
    held, told_of = explanation_text(explained).splitlines()[-1].strip().split(" ms: ")
    assert float(held.removeprefix("held ")) >= 0
    assert told_of == waited
    simulated = explanation_text(explained, simulated=True).splitlines()[-1].strip()
    assert simulated == f"held: {waited}", "it came at a time of another clock"


async def test_a_wait_in_vain_tells_what_was_not_heard(server: Server, session: str) -> None:
    async with (
        attached(server, "base", session=session, spec="office", streams=["/cmd", "/chat"]) as base,
        attached(server, "arm", session=session, streams=["/odom"]) as arm,
    ):
        await arm.send(make_event(1, "/odom", at=5, data={"speed": 0}))
        await arm.send(make_clock("/odom", 6))
        await base.send(make_clock("/chat", 30))
        assert (await base.ask(1, stream="/cmd", at=20, data={"v": 1}))["decision"] == "allow"
        await base.acked(1)
    (record,) = server.records(session, property="cmd_small", stream="/cmd")
    assert record["released"] == "max_delay"
    assert record["waited"] == [{"monitor": "arm", "stream": "/odom", "kind": "topic"}]
