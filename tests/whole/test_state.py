"""What a session's state tells of its order."""

from __future__ import annotations

import re

from tests.whole.client import attached, make_clock, make_event
from tests.whole.harness import Server


async def test_the_state_tells_what_is_waited_for_and_since_when(server: Server, session: str) -> None:
    async with attached(server, "uav1", session=session, spec="pair", streams=["/a", "/go"]) as monitor:
        await monitor.send(make_clock("/a", at=50), make_clock("/go", at=50, kind="response"))
        await monitor.send(make_event(1, "/a", at=60, data={"v": 1}))
        await server.holds(session, 1)
        state = server.get(f"sessions/{session}")
        assert state["awaited"] == {"monitor": "uav1", "stream": "/go", "kind": "request"}
        assert re.fullmatch(r"held \d+ ms for /go requests of uav1", state["waiting"])
        await monitor.send(make_clock("/go", at=70, kind="request"), make_clock("/go", at=70, kind="response"))
        await monitor.acked(1)
    state = server.get(f"sessions/{session}")
    assert (state["awaited"], state["waiting"]) == (None, None)
    assert state["hold"]["count"] == 1
    assert [b["count"] for b in state["hold"]["buckets"]] == sorted(b["count"] for b in state["hold"]["buckets"])
    assert state["hold"]["buckets"][-1] == {"le": None, "count": 1}


async def test_late_lost_and_repeated_events_are_counted_by_stream(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(make_event(1, at=20, data={"v": 1}), make_event(2, at=10, data={"v": 1}))
        await monitor.send(make_event(2, at=10, data={"v": 1}), make_event(3, at=30, lost=2, data={"v": 1}))
        await monitor.acked(3)
        (stream,) = server.get(f"sessions/{session}")["streams"]
        assert {name: stream[name] for name in ("late", "lost", "duplicates", "depth")} == {
            "late": 1,
            "lost": 2,
            "duplicates": 1,
            "depth": 0,
        }
    state = server.http.delete(f"/api/v1/sessions/{session}").json()
    assert [s["late"] for s in state["streams"]] == [1], "a closed session tells it too"


async def test_the_state_names_what_the_orders_disagree_on(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="both", streams=["/a", "/b"]) as monitor:
        await monitor.send(make_event(1, "/b", at=20, data={"v": 1}), make_event(2, "/a", at=10, data={"v": 1}))
        await monitor.send(make_clock("/a", at=30), make_clock("/b", at=30))
        await monitor.acked(2)
    assert server.get(f"sessions/{session}")["disagree"] == ["b_after_a"]


async def test_an_event_is_counted_once_in_whatever_orders_it_is_judged(server: Server, session: str) -> None:
    year = 365 * 86_400 * 10**3  # ms
    async with attached(server, session=session, spec="both", streams=["/a"]) as monitor:
        await monitor.send(make_event(1, "/a", at=10, lost=2), make_event(2, "/a", at=30 * year))
        await monitor.acked(2)
        state = server.get(f"sessions/{session}")
        assert [stream["lost"] for stream in state["streams"]] == [2]
        assert (state["counters"]["lost"], state["counters"]["skewed"], state["counters"]["steps"]) == (2, 1, 2)
