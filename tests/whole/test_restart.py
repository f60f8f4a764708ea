"""A server that stops, or dies, and the one that goes on after it."""

from __future__ import annotations

import signal
from typing import Any

import pytest

from tests.whole.client import attached, make_clock, make_event, monitors, stable
from tests.whole.conftest import Starts
from tests.whole.stories import STREAMS, play, tell

CLAIMED = ["/a", "/b", "/go", "/free"]
PATIENT = {"ORACLE_RESUME_WITHIN": "3600"}


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
async def test_a_server_that_stops_tells_its_monitors(start: Starts, number: signal.Signals) -> None:
    server = start()
    async with (
        attached(server, "m1", session="one", spec="single") as first,
        attached(server, "m2", spec="single") as second,
    ):
        status = server.stop(number)
        for monitor in (first, second):
            frames, code = await monitor.closed()
            assert code == 1012
            assert [f.get("code") for f in frames if f["type"] == "error"] == ["shutting_down"]
    assert status == 0


async def test_what_is_held_when_the_server_stops_is_judged_in_order(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="slow") as monitor:
        await monitor.send(make_event(1, "/b", at=20), make_event(2, "/b", at=10, source="another"))
        await server.holds("s", 2)
        assert server.stop() == 0
        frames, code = await monitor.closed()
        assert code == 1012
        assert {"type": "ack", "upto": 2} in frames
        assert [f["seq"] for f in frames if f["type"] == "violation"] == [2]
    server = start()
    records = server.records("s", property="b_after_a")
    assert [(r["seq"], r["step"], r["late"], r["outcome"]) for r in records] == [
        (2, 1, False, "currently_false"),
        (1, 2, False, "currently_false"),
    ]
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 3


@pytest.mark.parametrize("seed", range(3))
async def test_verdicts_go_on_as_if_the_server_had_not_stopped(start: Starts, seed: int) -> None:
    story = tell(seed, chunks=4)
    server = start()
    decisions: dict[str, dict[int, Any]] = {"whole": {}, "cut": {}}
    async with attached(server, session="whole", spec="pair", streams=CLAIMED) as monitor:
        for chunk in story:
            decisions["whole"] |= await play(monitor, chunk)
    following = 1
    for chunk in story:
        async with attached(server, session="cut", spec="pair", streams=CLAIMED) as monitor:
            assert monitor.attached["next"] == following
            decisions["cut"] |= await play(monitor, chunk)
            following = chunk.last + 1
        states = {p["id"]: p for p in server.get("sessions/cut")["properties"]}
        counters = server.get("sessions/cut")["counters"]
        assert server.stop() == 0
        server = start()
        assert {p["id"]: p for p in server.get("sessions/cut")["properties"]} == states
        assert server.get("sessions/cut")["counters"] == counters
    assert decisions["cut"] == decisions["whole"]
    cut, whole = stable(server.records("cut")), stable(server.records("whole"))
    assert [r["n"] for r in whole] == list(range(1, len(whole) + 1))
    assert cut == whole


async def test_a_refused_event_counts_as_lost_across_a_restart(start: Starts) -> None:
    server = start()
    for session in ("whole", "cut"):
        async with attached(server, session=session, spec="single") as monitor:
            await monitor.send(make_event(1, data={"v": 1}), make_event(2, at=1) | {"data": 7})
            await monitor.expect("error", seq=2)
            await monitor.acked(2)
            if session == "whole":
                await monitor.send(make_event(3, at=2, data={"v": 1}))
                await monitor.acked(3)
    assert server.stop() == 0
    server = start()
    async with attached(server, session="cut") as monitor:
        await monitor.send(make_event(3, at=2, data={"v": 1}))
        await monitor.acked(3)
    assert stable(server.records("cut")) == stable(server.records("whole"))
    assert server.get("sessions/cut")["counters"] == server.get("sessions/whole")["counters"]


async def test_after_an_event_that_was_refused_all_verdicts_are_degraded(start: Starts) -> None:
    """At once, and not from its monitor's next event on; also where nothing was judged between it and a restart."""
    server = start()
    async with attached(server, "m1", session="s", spec="single") as first:
        await first.send(make_event(1, data={"v": 1}), make_event(2, at=1) | {"data": 7})
        await first.acked(2)
        server.process.send(signal.SIGKILL)
        await first.closed()
    server.end()
    server = start()
    async with attached(server, "m2", session="s") as second:
        await second.send(make_event(1, at=2, data={"v": 1}))
        await second.acked(1)
        async with attached(server, "m3", session="s") as third:
            await third.send(make_event(1, at=3) | {"data": 7})
            await third.acked(1)
        await second.send(make_event(2, at=4, data={"v": 1}))
        await second.acked(2)
    assert [(r["monitor"], r["degraded"]) for r in server.records("s")] == [("m1", False), ("m2", True), ("m2", True)]


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
@pytest.mark.parametrize("seed", range(2))
async def test_a_server_that_ends_in_the_middle_of_a_flood_loses_and_doubles_nothing(
    start: Starts, seed: int, number: signal.Signals
) -> None:
    (chunk,) = tell(seed, chunks=1, length=300, mischief=False)
    server = start()
    async with attached(server, session="whole", spec="pair", streams=CLAIMED) as monitor:
        await play(monitor, chunk)
    async with attached(server, session="cut", spec="pair", streams=CLAIMED) as monitor:
        await monitor.send(*chunk.events[:200])
        await monitor.acked(20)
        server.process.send(number)
        await monitor.closed()
        acked = monitor.upto
    assert server.process.wait() == (0 if number is signal.SIGTERM else -number)
    server.end()
    server = start()
    async with attached(server, session="cut", spec="pair", streams=CLAIMED) as monitor:
        following = monitor.attached["next"]
        assert acked < following <= 201
        chunk.events = chunk.events[following - 1 :]
        await play(monitor, chunk)
    unsaid = [{k: v for k, v in r.items() if k != "passed"} for r in stable(server.records("cut"))]
    assert unsaid == [{k: v for k, v in r.items() if k != "passed"} for r in stable(server.records("whole"))]


async def test_an_event_judged_by_arrival_and_still_held_outlives_a_server_that_is_killed(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="both") as monitor:
        await monitor.send(make_event(1, "/b", at=20))
        await server.until(lambda: server.records("s"), lambda records: len(records) == 1)
        server.process.send(signal.SIGKILL)
        await monitor.closed()
    server.end()
    server = start()
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 1
        await monitor.send(make_event(1, "/b", at=20), make_event(2, "/a", at=10), make_clock("/a", at=30))
        await monitor.acked(2)
    assert [(r["n"], r["order"], r["seq"], r["outcome"]) for r in server.records("s")] == [
        (1, "arrival", 1, "currently_false"),
        (2, "arrival", 2, "true"),
        (3, "publication", 2, "true"),
        (4, "publication", 1, "true"),
    ]


async def test_an_ask_is_answered_from_the_record_after_a_restart(start: Starts) -> None:
    server = start()
    clocks = [make_clock(name, 100, kind) for name, kind in STREAMS if name != "/go" or kind != "request"]
    requests = [make_event(seq, "/go", seq, {"v": 1}, kind="request", call=seq, ask=True) for seq in (1, 2)]
    async with attached(server, session="s", spec="pair", streams=CLAIMED) as monitor:
        await monitor.send(*clocks, *requests)
        answers = [await monitor.expect("decision", seq=seq) for seq in (1, 2)]
        await monitor.acked(2)
    assert server.stop() == 0
    server = start()
    async with attached(server, session="s", streams=CLAIMED) as monitor:
        await monitor.send(*requests)
        assert [await monitor.expect("decision", seq=seq) for seq in (1, 2)] == answers
    assert len({r["step"] for r in server.records("s")}) == 2


async def test_a_restarted_session_waits_for_its_monitors_to_come_back(start: Starts) -> None:
    server = start()
    async with (
        attached(server, "m1", session="s", spec="pair", streams=["/a"]) as first,
        attached(server, "m2", session="s", streams=["/b"]) as second,
    ):
        await first.send(make_event(1, "/a", at=10, data={"id": 1}))
        await second.send(make_event(1, "/b", at=10, data={"id": 1}))
        await first.acked(1)
        await second.acked(1)
        assert server.stop() == 0
    server = start(**PATIENT)
    assert {name: m["connected"] for name, m in monitors(server, "s").items()} == {"m1": False, "m2": False}
    async with attached(server, "m2", session="s", streams=["/b"]) as second:
        await second.send(make_event(2, "/b", at=30, data={"id": 2}))
        await server.holds("s", 1)
        async with attached(server, "m1", session="s", streams=["/a"]) as first:
            await first.send(make_event(2, "/a", at=20, data={"id": 2}), make_clock("/a", at=40))
            await second.acked(2)
    records = server.records("s", property="b_after_a")
    assert [(r["monitor"], r["seq"], r["outcome"]) for r in records] == [
        ("m1", 1, "currently_true"),
        ("m2", 1, "currently_true"),
        ("m1", 2, "currently_true"),
        ("m2", 2, "currently_true"),
    ]


async def test_a_restarted_session_goes_on_without_monitors_that_do_not_come_back(start: Starts) -> None:
    server = start()
    async with attached(server, "m1", session="s", spec="pair", streams=["/a"]) as first:
        await first.send(make_event(1, "/a", at=10))
        await first.acked(1)
        assert server.stop() == 0
    server = start(ORACLE_RESUME_WITHIN="0.05")
    async with attached(server, "m2", session="s", streams=["/b"]) as second:
        await second.send(make_event(1, "/b", at=30))
        await second.acked(1)


async def test_a_restarted_session_does_not_wait_for_a_monitor_that_had_detached(start: Starts) -> None:
    server = start()
    async with attached(server, "m1", session="s", spec="pair", streams=["/a"]) as first:
        await first.send(make_event(1, "/a", at=10))
        await first.detach()
    assert server.stop() == 0
    server = start(**PATIENT)
    assert not monitors(server, "s")["m1"]["attached"]
    async with attached(server, "m2", session="s", streams=["/b"]) as second:
        await second.send(make_event(1, "/b", at=30), make_event(1, "/b", at=30))
        await second.acked(1)


async def test_a_session_of_its_own_is_joined_again_after_a_restart(start: Starts) -> None:
    server = start()
    async with attached(server, spec="single") as monitor:
        session = monitor.attached["session"]
        await monitor.send(make_event(1, data={"v": 11}))
        await monitor.acked(1)
        assert server.stop() == 0
    server = start(**PATIENT)
    async with attached(server, session=session) as monitor:
        assert monitor.attached["next"] == 2
        await monitor.send(make_event(2, at=1, data={"v": 11}))
        await monitor.detach()
    await server.until(lambda: server.get(f"sessions/{session}"), lambda s: s["status"] == "closed")
    assert server.stop() == 0
    server = start()
    assert server.get(f"sessions/{session}")["status"] == "closed"
    assert [r["outcome"] for r in server.records(session)] == ["currently_false"] * 2
    assert len(server.records(session, "violations")) == 1


async def test_what_a_monitor_had_not_had_acked_is_told_by_next(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1), make_event(4, at=1), make_event(5, "/nowhere", at=2))
        await monitor.acked(5)
    assert server.stop() == 0
    server = start()
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 6
    counters = server.get("sessions/s")["counters"]
    assert (counters["steps"], counters["lost"], counters["refused"]) == (2, 2, 1)


async def test_what_was_known_to_be_lost_is_known_after_a_restart(start: Starts) -> None:
    """The event that tells of a loss is still held: what was judged since was degraded, and what comes is too."""
    server = start()
    async with (
        attached(server, "m1", session="s", spec="pair", streams=["/a"]) as first,
        attached(server, "m2", session="s", streams=["/b"]) as second,
    ):
        await first.send(make_event(1, "/a", at=10))
        await second.send(make_event(1, "/b", at=10))
        await second.acked(1)
        await first.send(make_event(4, "/a", at=100))
        await server.holds("s", 1)
        await second.send(make_event(2, "/b", at=50))
        await second.acked(2)
        server.process.send(signal.SIGKILL)
        await first.closed()
    server.end()
    server = start(**PATIENT)
    async with (
        attached(server, "m1", session="s", streams=["/a"]) as first,
        attached(server, "m2", session="s", streams=["/b"]) as second,
    ):
        assert first.attached["next"] == 2
        await first.send(make_clock("/a", at=100))
        await second.send(make_event(3, "/b", at=60))
        await second.acked(3)
    records = server.records("s", property="b_after_a", stream="/b")
    assert [(r["seq"], r["degraded"]) for r in records] == [(1, False), (2, True), (3, True)]


async def test_what_was_told_as_lost_and_comes_after_all_is_judged(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="single") as monitor:
        await monitor.send(make_event(1), make_event(5, at=1), make_event(3, at=2), make_event(3, at=2))
        await monitor.acked(5)
    assert [r["seq"] for r in server.records("s")] == [1, 5, 3]
    assert server.stop() == 0
    server = start()
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 6


async def test_what_is_held_of_a_monitor_that_had_detached_keeps_nobody_waiting(start: Starts) -> None:
    """And what was lost before it is known, and settled with it."""
    server = start()
    async with (
        attached(server, "m1", session="s", spec="both", streams=["/a"]) as first,
        attached(server, "m2", session="s", streams=["/b"]) as second,
    ):
        await second.send(make_event(3, "/b", at=20), {"type": "detach"})
        await server.until(lambda: server.records("s"), lambda records: len(records) == 1)
        await first.send(make_event(1, "/a", at=10))
        await server.until(lambda: server.records("s"), lambda records: len(records) == 3)
        server.process.send(signal.SIGKILL)
        await first.closed()
    server.end()
    server = start(**PATIENT)
    (stream,) = [s for s in server.get("sessions/s")["streams"] if s["stream"] == "/b"]
    assert (stream["lost"], stream["depth"]) == (2, 1)
    async with attached(server, "m1", session="s", streams=["/a"]) as first:
        await first.send(make_event(2, "/a", at=40))
        await first.acked(2)
    records = [(r["order"], r["seq"], r["degraded"]) for r in server.records("s")]
    assert records == [
        ("arrival", 3, True),
        ("arrival", 1, True),
        ("publication", 1, True),
        ("arrival", 2, True),
        ("publication", 3, True),
        ("publication", 2, True),
    ]
    async with attached(server, "m2", session="s", streams=["/b"]) as second:
        assert second.attached["next"] == 4


def test_a_session_in_which_nothing_was_judged_is_restored_without_a_warning(start: Starts) -> None:
    server = start()
    assert server.http.post("/api/v1/sessions", json={"spec": "single", "id": "empty"}).status_code == 201
    assert server.stop() == 0
    server = start()
    assert server.get("sessions/empty")["status"] == "open"
    assert "judged again" not in server.log
