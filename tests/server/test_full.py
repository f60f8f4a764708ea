"""An order that is full: the oldest event is judged before its time, and verdicts are degraded."""

from __future__ import annotations

from tests.server.client import attached, judged, make_clock, make_event, make_events, monitors
from tests.server.harness import Server


async def test_a_full_order_judges_its_oldest_and_says_so(server: Server, session: str) -> None:
    async with (
        attached(server, "behind", session=session, spec="tiny", streams=["/b"]),
        attached(server, "ahead", session=session, streams=["/a"]) as ahead,
    ):
        await ahead.send(make_events(*(make_event(i, "/a", at=10 * i, data={"v": i}) for i in range(1, 51))))
        await ahead.acked(45)
        await server.holds(session, 5)
    assert judged(server, session)[:45] == [("ahead", "/a", i) for i in range(1, 46)]
    assert all(r["degraded"] for r in server.records(session))


async def test_one_monitor_alone_is_never_held_up(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="tiny") as monitor:
        await monitor.send(make_events(*(make_event(i, "/a", at=i, data={"v": 1}) for i in range(1, 51))))
        await monitor.acked(45)
        await monitor.detach()
    assert [seq for _, _, seq in judged(server, session)] == list(range(1, 51))


async def test_a_monitor_that_is_lost_while_its_events_wait_is_missed(server: Server, session: str) -> None:
    async with attached(server, "behind", session=session, spec="tiny", streams=["/b"]) as behind:
        async with attached(server, "ahead", session=session, streams=["/a"]) as ahead:
            await ahead.send(*(make_event(i, "/a", at=i, data={"v": 1}) for i in range(1, 51)))
            await server.holds(session, 5)
            ahead.vanish()
        await server.until(lambda: monitors(server, session)["ahead"], lambda m: not m["connected"])
        async with attached(server, "ahead", session=session, instance="another", streams=["/a"]) as ahead:
            following = ahead.attached["next"]
            await behind.send(make_clock("/b", 1000))
            await ahead.send(make_event(following, "/a", at=500, data={"v": 1}), make_clock("/a", 1000))
            await ahead.acked(following)
    assert [seq for _, _, seq in judged(server, session)] == list(range(1, following + 1))


async def test_a_session_is_closed_though_events_wait(server: Server, session: str) -> None:
    async with (
        attached(server, "behind", session=session, spec="tiny", streams=["/b"]),
        attached(server, "ahead", session=session, streams=["/a"]) as ahead,
    ):
        await ahead.send(make_events(*(make_event(i, "/a", at=i, data={"v": 1}) for i in range(1, 51))))
        await server.holds(session, 5)
        state = server.http.delete(f"/api/v1/sessions/{session}").json()
        _, code = await ahead.closed()
        assert code == 1008
    assert [seq for _, _, seq in judged(server, session)] == list(range(1, state["counters"]["steps"] + 1))
    assert ahead.upto == state["counters"]["steps"]
