"""Sessions in simulated time: never mixed with wall time, and ended when it goes back."""

from __future__ import annotations

import signal

import pytest
from oracle_adapter import Link

from tests.whole.client import Monitor, attached, connected, make_attach, make_clock, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server


def sim_clock(at: int, stream: str = "/a") -> dict[str, object]:
    return {"type": "clock", "stamps": [{"stream": stream, "kind": "topic", "stamp": at}]}


async def refused(monitor: Monitor) -> tuple[str, str | None]:
    """The code of the error by which a connection ends, and the session that it names."""
    frames, code = await monitor.closed()
    assert code == 1008
    assert frames[-1]["fatal"]
    return frames[-1]["code"], frames[-1].get("session")


async def test_a_session_does_not_mix_simulated_and_wall_time(start: Starts) -> None:
    server, session = start(), "s"
    async with attached(server, "m1", session=session, spec="pair", streams=["/a"], clock="sim"):
        assert server.get(f"sessions/{session}")["clock"] == "sim"
        async with connected(server) as other:
            await other.send(make_attach("m2", session=session, streams=["/b"]))
            assert await refused(other) == ("clock_mismatch", None)
        server.stop(signal.SIGKILL)
    server = start()
    async with connected(server) as other:
        await other.send(make_attach("m2", session=session, streams=["/b"], clock="wall"))
        assert await refused(other) == ("clock_mismatch", None)
    async with attached(server, "m1", session="w", spec="pair", streams=["/a"]), connected(server) as other:
        await other.send(make_attach("m2", session="w", streams=["/b"], clock="sim"))
        assert await refused(other) == ("clock_mismatch", None)


async def test_stamps_and_arrivals_are_in_simulated_time(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"], clock="sim") as monitor:
        await monitor.send(sim_clock(10**9), make_event(1, stamp=10**9 + 5, data={"v": 1}))
        await monitor.send(make_event(2, stamp=None, data={"v": 1}), make_event(3, at=0, data={"v": 1}))
        await monitor.send(sim_clock(2 * 10**9))
        await monitor.acked(3)
    first, second, third = server.records(session, property="a_is_small")
    arrived = 10**9 + 20 * 10**6
    assert [(r["stamp"], r["arrived"], r["skewed"]) for r in (first, second)] == [
        (10**9 + 5, arrived, False),
        (arrived, arrived, False),
    ]
    assert third["skewed"], "it is stamped with wall time"
    assert not any(r["late"] for r in (first, second, third))


async def test_time_that_goes_back_ends_the_session_for_all_and_names_the_next(server: Server, session: str) -> None:
    async with (
        attached(server, "m1", session=session, spec="pair", streams=["/a"], clock="sim") as first,
        attached(server, "m2", session=session, streams=["/b"], clock="sim") as second,
    ):
        await first.send(make_event(1, stamp=8 * 10**9, data={"v": 1}), sim_clock(9 * 10**9))
        await first.send(sim_clock(10**9), make_event(2, stamp=10**9, data={"v": 1}))
        named = f"{session}.run2"
        assert await refused(first) == ("session_ended", named)
        assert await refused(second) == ("session_ended", named)
    state = server.get(f"sessions/{session}")
    assert (state["status"], state["continued_by"]) == ("closed", named)
    assert [r["seq"] for r in server.records(session, property="a_is_small")] == [1]
    async with connected(server) as away:
        await away.send(make_attach("m3", session=session, clock="sim"))
        assert await refused(away) == ("session_ended", named)
    async with attached(server, "m1", session=named, spec="pair", streams=["/a"], clock="sim") as first:
        await first.send(make_event(1, stamp=10**9, data={"v": 1}), sim_clock(2 * 10**9))
        await first.acked(1)
        await first.send(sim_clock(10**9))
        assert await refused(first) == ("session_ended", f"{session}.run3")


@pytest.mark.parametrize("away", ["server", "monitor"])
async def test_a_simulation_that_starts_anew_meanwhile_is_noticed(start: Starts, away: str) -> None:
    """The whole launch was started anew: by another process, or by a monitor of another name."""
    server, name = start(), "m1" if away == "server" else "m2"
    async with attached(server, "m1", instance="p1", session="s", spec="pair", streams=["/a"], clock="sim") as monitor:
        await monitor.send(sim_clock(9 * 10**9), make_event(1, stamp=9 * 10**9, data={"v": 1}))
        await monitor.send(sim_clock(10 * 10**9))
        await monitor.acked(1)
        if away == "server":
            server.stop(signal.SIGKILL)
        else:
            await monitor.detach()
    if away == "server":
        server = start()
    async with attached(server, name, instance="p2", session="s", spec="pair", streams=["/a"], clock="sim") as monitor:
        await monitor.send(sim_clock(10**9))
        assert await refused(monitor) == ("session_ended", "s.run2")


async def test_links_go_on_in_the_next_session(server: Server, session: str) -> None:
    """What was sent before the time went back is in the one session, what was sent after it in the other."""
    with (
        Link(server.url, "m1", spec="pair", session=session, streams=["/a"], clock="sim") as one,
        Link(server.url, "m2", spec="pair", session=session, streams=["/b"], clock="sim") as two,
    ):
        for link, stream in ((one, "/a"), (two, "/b")):
            link.wait_attached(PATIENCE)
            link.clock([(stream, "topic", 9 * 10**9)])
        one.send("/a", "topic", 8 * 10**9, {"v": 1})
        one.renew(lambda: [("/a", "topic", 10**9)])
        one.send("/a", "topic", 10**9 + 1, {"v": 2})
        one.clock([("/a", "topic", 10**9 + 2)])
        answer = one.ask("/a", "topic", 10**9 + 3, {"v": 3}, decide_within=PATIENCE)
        await server.until(lambda: server.get(f"sessions/{session}")["status"], lambda status: status == "closed")
        named = server.get(f"sessions/{session}")["continued_by"]
        await server.until(lambda: two.wait_attached(PATIENCE).session, lambda attached: attached == named)
        two.clock([("/b", "topic", 2 * 10**9)])
        one.clock([("/a", "topic", 2 * 10**9)])
        assert answer.result(PATIENCE).decision == "allow"
    assert [r["stamp"] for r in server.records(session, property="a_is_small")] == [8 * 10**9]
    assert [r["stamp"] for r in server.records(named, property="a_is_small")] == [10**9 + 1, 10**9 + 3]
    assert one.stats().lost == 0


async def test_a_straggler_of_the_time_before_makes_nothing_late(server: Server, session: str) -> None:
    """It comes after the clock went back, and first of all in the next session."""
    with Link(server.url, "m1", spec="pair", session=session, streams=["/a"], clock="sim") as link:
        link.wait_attached(PATIENCE)
        link.clock([("/a", "topic", 60 * 10**9)])
        link.renew(lambda: [("/a", "topic", 10**9)])
        link.send("/a", "topic", 60 * 10**9, {"v": 1})
        link.send("/a", "topic", 15 * 10**8, {"v": 2})
        link.send("/a", "topic", 16 * 10**8, {"v": 3})
        link.clock([("/a", "topic", 2 * 10**9)])
        await server.until(lambda: link.stats().acked, lambda acked: acked == 3)
    records = server.records(server.get(f"sessions/{session}")["continued_by"], property="a_is_small")
    assert [(r["skewed"], r["late"]) for r in records] == [(True, False), (False, False), (False, False)]


async def test_a_session_without_a_name_goes_on_in_a_new_one(server: Server) -> None:
    with Link(server.url, "m1", spec="pair", streams=["/a"], clock="sim") as link:
        first = link.wait_attached(PATIENCE).session
        link.clock([("/a", "topic", 9 * 10**9)])
        link.renew(lambda: [("/a", "topic", 10**9)])
        link.send("/a", "topic", 10**9 + 1, {"v": 2})
        link.clock([("/a", "topic", 10**9 + 2)])
        await server.until(lambda: link.stats().acked, lambda acked: acked == 1)
        second = link.wait_attached(PATIENCE).session
    assert first != second
    assert server.get(f"sessions/{first}")["continued_by"] is None
    assert len(server.records(second, property="a_is_small")) == 1


async def test_wall_time_may_go_back(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        await monitor.send(make_clock("/a", at=10), make_clock("/a", at=5), make_event(1, at=9, data={"v": 1}))
        await monitor.acked(1)


async def test_the_latest_time_that_there_is_can_be_kept(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"], clock="sim") as monitor:
        await monitor.send(sim_clock(2**63 - 1), make_event(1, stamp=None, data={"v": 1}))
        await monitor.acked(1)
    assert [r["arrived"] for r in server.records(session, property="a_is_small")] == [2**63 - 1]


async def test_how_long_a_decision_takes_is_told_in_the_server_s_time(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="lamp", streams=["/switch"], clock="sim") as monitor:
        request = {"stream": "/switch", "kind": "request", "data": {"switch_on": True}, "call": 1}
        await monitor.send(make_clock("/switch", 0, "response"))
        await monitor.ask(1, stamp=10**9, **request)
    (told,) = [
        line for line in server.http.get("/metrics").text.splitlines() if line.startswith("oracle_decision_seconds_sum")
    ]
    assert float(told.split()[1]) < 10**6, "not the years between the two times"
