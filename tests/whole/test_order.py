"""The order of events: what a session waits for, and what becomes of those that come late."""

from __future__ import annotations

from tests.whole.client import attached, judged, make_clock, make_event, monitors
from tests.whole.conftest import Starts
from tests.whole.harness import Server


async def test_two_monitors_are_put_in_one_order(server: Server, session: str) -> None:
    async with (
        attached(server, "m1", session=session, spec="pair", streams=["/a"]) as first,
        attached(server, "m2", session=session, spec="pair", streams=["/b"]) as second,
    ):
        await second.send(make_event(1, "/b", at=20, data={"id": 1}))
        await second.send(make_event(2, "/b", at=40, data={"id": 2}))
        await first.send(make_event(1, "/a", at=10, data={"id": 1}))
        await first.send(make_event(2, "/a", at=30, data={"id": 2}))
        await first.send(make_clock("/a", at=50))
        await second.acked(2)
        await first.acked(2)
    assert judged(server, session) == [("m1", "/a", 1), ("m2", "/b", 1), ("m1", "/a", 2), ("m2", "/b", 2)]
    records = server.records(session)
    assert [r["n"] for r in records] == list(range(1, len(records) + 1))
    assert {r["outcome"] for r in records} == {"currently_true"}
    assert not any(r["late"] or r["degraded"] for r in records)


async def test_a_late_event_is_judged_and_marked(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(make_event(1, at=20, data={"v": 1}), make_event(2, at=10, data={"v": 11}))
        await monitor.acked(2)
        (violation,) = await monitor.violated(1)
    assert (violation["seq"], violation["property"], violation["late"]) == (2, "a_is_small", True)
    records = server.records(session, property="a_is_small")
    assert [(r["seq"], r["step"], r["outcome"], r["late"]) for r in records] == [
        (1, 1, "currently_true", False),
        (2, 2, "currently_false", True),
    ]
    assert server.get(f"sessions/{session}")["counters"]["late"] == 1


async def test_a_late_event_is_skipped_where_the_spec_says_so(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="strict") as monitor:
        await monitor.send(make_event(1, at=20, data={"v": 1}), make_event(2, at=10, data={"v": 11}))
        await monitor.send(make_event(3, at=30, data={"v": 1}))
        await monitor.acked(3)
        assert monitor.violations == []
    assert [(r["n"], r["seq"], r["step"], r["outcome"], r["late"], r["degraded"]) for r in server.records(session)] == [
        (1, 1, 1, "currently_true", False, False),
        (2, 2, None, "unknown", True, False),
        (3, 3, 2, "currently_true", False, True),
    ]


async def test_an_unordered_stream_is_judged_at_once(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a", "/b", "/free"]) as monitor:
        await monitor.send(make_event(1, "/a", at=20, data={"v": 1}), make_event(2, "/free", at=10, data={"v": 1}))
        await monitor.send(make_clock("/b", at=30))
        await monitor.acked(2)
    assert judged(server, session) == [("m1", "/free", 2), ("m1", "/a", 1)]
    assert not any(r["late"] for r in server.records(session))


async def test_an_unclaimed_stream_holds_nothing_and_is_refused(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        assert [s["name"] for s in monitor.attached["streams"]] == ["/a"]
        await monitor.send(make_event(1, "/a", data={"v": 1}), make_event(2, "/b"))
        await monitor.expect("error", code="unknown_stream", seq=2)
        await monitor.acked(2)
        await monitor.send(make_clock("/b", at=10))
        await monitor.expect("error", code="unknown_stream")
    assert judged(server, session) == [("m1", "/a", 1)]


async def test_a_claimed_service_is_claimed_with_its_requests_and_responses(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/go"]) as monitor:
        streams = [(s["name"], s["kind"]) for s in monitor.attached["streams"]]
        assert streams == [("/go", "request"), ("/go", "response")]


async def test_claims_can_change_with_a_new_connection(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a", "/b"]) as old:
        await old.send(make_event(1, "/a", data={"v": 1}))
        await server.holds(session, 1)
        async with attached(server, session=session, streams=["/a"]) as new:
            await new.acked(1)
    assert judged(server, session) == [("m1", "/a", 1)]


async def test_a_lost_monitor_holds_the_order_while_it_may_come_back(start: Starts) -> None:
    server, session = start(ORACLE_RESUME_WITHIN="3600"), "s"
    async with attached(server, "m2", session=session, spec="pair", streams=["/b"]) as second:
        async with attached(server, "m1", session=session, streams=["/a"]) as first:
            first.vanish()
        await server.until(lambda: monitors(server, session)["m1"], lambda m: not m["connected"])
        await second.send(make_event(1, "/b", at=20, data={"id": 1}))
        await second.send(make_event(1, "/b", at=20, data={"id": 1}, ask=True))
        assert await second.recv() == {"type": "ack", "upto": 0}
        state = server.get(f"sessions/{session}")
        assert state["counters"]["held"] == 1
        assert {m["name"]: m["attached"] for m in state["monitors"]} == {"m1": True, "m2": True}
        async with attached(server, "m1", session=session, streams=["/a"]) as first:
            await first.send(make_event(1, "/a", at=10, data={"id": 1}), make_clock("/a", at=30))
            await second.acked(1)
    assert judged(server, session) == [("m1", "/a", 1), ("m2", "/b", 1)]


async def test_a_lost_monitor_leaves_the_order_when_it_does_not_come_back(start: Starts) -> None:
    server, session = start(ORACLE_RESUME_WITHIN="0.05"), "s"
    async with attached(server, "m2", session=session, spec="pair", streams=["/b"]) as second:
        async with attached(server, "m1", session=session, streams=["/a"]) as first:
            await second.send(make_event(1, "/b", at=20, data={"id": 1}))
            await server.holds(session, 1)
            first.vanish()
        await second.acked(1)
        assert not monitors(server, session)["m1"]["attached"]
        async with attached(server, "m1", session=session, instance="m1-2", streams=["/a"]) as first:
            await first.send(make_event(1, "/a", at=10, data={"id": 1}))
            await first.acked(1)
    assert [r["late"] for r in server.records(session, property="b_after_a")] == [False, True]


async def test_a_monitor_that_detaches_leaves_the_order(server: Server, session: str) -> None:
    async with attached(server, "m2", session=session, spec="pair", streams=["/b"]) as second:
        async with attached(server, "m1", session=session, streams=["/a"]) as first:
            await second.send(make_event(1, "/b", at=20, data={"id": 1}))
            await first.detach()
        await second.acked(1)


async def test_what_waits_its_longest_is_judged_without_another_word(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="prompt") as monitor:
        await monitor.send(make_event(1, "/b", at=20, data={"v": 1}), make_event(2, "/b", at=10, source="another"))
        await monitor.acked(2)
    assert judged(server, session) == [("m1", "/b", 2), ("m1", "/b", 1)]


async def test_what_a_monitor_says_after_it_detached_holds_nothing(server: Server, session: str) -> None:
    async with attached(server, "m2", session=session, spec="pair", streams=["/b"]) as second:
        async with attached(server, "m1", session=session, streams=["/a"]) as first:
            await second.send(make_clock("/b", at=15))
            await server.until(
                lambda: [s["frontier"] for s in server.get(f"sessions/{session}")["streams"] if s["stream"] == "/b"],
                lambda frontiers: frontiers != [None],
            )
            await first.send(make_event(1, "/a", at=10), {"type": "detach"}, make_event(2, "/a", at=11))
            await first.closed()
        await second.send(make_event(1, "/b", at=20, data={"id": 1}), make_event(1, "/b", at=20))
        assert [s["monitor"] for s in server.get(f"sessions/{session}")["streams"]] == ["m2"]
        await second.acked(1)
