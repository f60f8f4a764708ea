"""An order that is full: the oldest event is judged before its time, and verdicts are degraded."""

from __future__ import annotations

from oracle_adapter import Link

from tests.whole.client import BASE, attached, judged, make_clock, make_event, make_events, monitors
from tests.whole.harness import PATIENCE, Server


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


async def test_a_monitor_ahead_gets_credit_once_the_order_has_gone_on(server: Server, session: str) -> None:
    async with (
        attached(server, "behind", session=session, spec="tiny", streams=["/b"]) as behind,
        attached(server, "ahead", session=session, streams=["/a"]) as ahead,
    ):
        assert ahead.attached["limits"]["credit"] == 1
        for i in (1, 2):
            await ahead.send(make_event(i, "/a", at=i, data={"v": 1}))
            await ahead.expect("credit", events=1)
        await ahead.send(make_event(3, "/a", at=3, data={"v": 1}))
        await server.holds(session, 3)
        assert {name: m["credit"] for name, m in monitors(server, session).items()} == {"behind": 1, "ahead": 0}
        await behind.send(make_clock("/b", at=1))
        await ahead.expect("credit", events=1)


async def test_an_adapter_with_a_backlog_overfills_no_order(server: Server, session: str) -> None:
    """Two links have a thousand events each at hand from the start, for an order of two hundred."""
    with (
        Link(server.url, "one", spec="narrow", session=session, streams=["/a"]) as one,
        Link(server.url, "two", spec="narrow", session=session, streams=["/b"]) as two,
        Link(server.url, "three", spec="narrow", session=session, streams=["/c"]) as three,
    ):
        for link in (one, two, three):
            link.wait_attached(PATIENCE)
        for i in range(1, 1001):
            for link, stream in ((one, "/a"), (two, "/b")):
                link.send(stream, "topic", BASE + i, {"v": 1})
        for link, stream in ((one, "/a"), (two, "/b"), (three, "/c")):
            link.clock([(stream, "topic", BASE + 10**6)])
        await server.until(lambda: (one.stats().acked, two.stats().acked), lambda acked: acked == (1000, 1000))
        assert (one.stats().lost, two.stats().lost) == (0, 0)
    assert not any(r["degraded"] or r["late"] for r in server.records(session))


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
