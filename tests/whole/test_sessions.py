"""Sessions from outside: who joins them, what they share, how they close."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.whole.client import (
    Frame,
    attached,
    connected,
    judged,
    make_attach,
    make_clock,
    make_event,
    make_events,
    monitors,
)
from tests.whole.conftest import Starts
from tests.whole.harness import Server, problem, run


async def refused(server: Server, **attach: Any) -> Frame:
    """The error that an attach is answered with, before the connection is closed."""
    async with connected(server) as connection:
        await connection.send(make_attach(**attach))
        frames, code = await connection.closed()
    assert code == 1008
    assert [f["type"] for f in frames] == ["error"]
    return frames[0]


async def test_a_session_that_is_named_is_made_and_then_joined(server: Server, session: str) -> None:
    async with (
        attached(server, "m1", session=session, spec="pair") as first,
        attached(server, "m2", session=session, spec="pair") as second,
    ):
        assert first.attached["session"] == second.attached["session"] == session
        assert first.attached["spec_digest"] == second.attached["spec_digest"]
        state = server.get(f"sessions/{session}")
        assert state["status"] == "open"
        assert [(m["name"], m["attached"], m["connected"], m["next"]) for m in state["monitors"]] == [
            ("m1", True, True, 1),
            ("m2", True, True, 1),
        ]


async def test_a_session_is_joined_without_naming_its_spec(server: Server, session: str) -> None:
    async with attached(server, "m1", session=session, spec="pair"), attached(server, "m2", session=session) as second:
        assert second.attached["spec"] == "pair"


async def test_a_named_session_outlives_its_monitors(server: Server, session: str) -> None:
    async with attached(server, "m1", session=session, spec="single", streams=["/a"]) as monitor:
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.detach()
    async with attached(server, "m1", session=session) as monitor:
        assert monitor.attached["next"] == 2
        await monitor.send(make_event(2, at=1, data={"v": 1}))
        await monitor.acked(2)
    assert [r["seq"] for r in server.records(session)] == [1, 2]


async def test_a_session_of_its_own_ends_with_its_last_monitor(server: Server) -> None:
    async with attached(server, "m1", spec="pair", streams=["/a"]) as first:
        session = first.attached["session"]
        async with attached(server, "m2", session=session, streams=["/a"]) as second:
            await second.send(make_clock("/a", at=1))
            await first.send(make_event(1, data={"v": 1}))
            await first.detach()
            assert server.get(f"sessions/{session}")["status"] == "open"
            await second.send(make_event(1, at=1, data={"v": 2}))
            await second.detach()
    state = await server.until(lambda: server.get(f"sessions/{session}"), lambda s: s["status"] == "closed")
    assert state["counters"]["steps"] == 2
    assert judged(server, session) == [("m1", "/a", 1), ("m2", "/a", 1)]
    assert session in [s["id"] for s in server.get("sessions")["items"]]
    assert (await refused(server, session=session, spec="pair"))["code"] == "session_closed"


async def test_two_monitors_without_a_name_get_two_sessions(server: Server) -> None:
    async with attached(server, spec="pair") as first, attached(server, spec="pair") as second:
        assert first.attached["session"] != second.attached["session"]


async def test_a_session_of_its_own_ends_when_its_monitor_does_not_come_back(start: Starts) -> None:
    server = start(ORACLE_RESUME_WITHIN="0.05")
    async with attached(server, spec="pair", streams=["/a"]) as monitor:
        session = monitor.attached["session"]
        await monitor.send(make_event(1, data={"v": 1}))
        await monitor.acked(1)
        monitor.vanish()
    await server.until(lambda: server.get(f"sessions/{session}"), lambda s: s["status"] == "closed")
    assert judged(server, session) == [("m1", "/a", 1)]


async def test_who_attaches_by_a_robots_name_at_a_centre_is_told_where_that_session_is(server: Server) -> None:
    error = await refused(server, spec="pair", session="s1@robot7")
    assert error["code"] == "bad_attach"
    assert "a session of 'robot7', which is only read here: attach to the server there" in error["message"]
    assert error["message"].endswith("where it is 's1'")
    refusal = (await refused(server, spec="pair", session="s1@robot7@robot8"))["message"]
    assert refusal.startswith("session: 's1@robot7@robot8' is no name here: one has 1 to 64 letters of ASCII, digits,")


@pytest.mark.parametrize(("field", "name"), [("monitor", "7/x-é"), ("session", "a flight"), ("spec", "battery/uav")])
async def test_who_attaches_by_what_is_no_name_is_told_what_a_name_has(server: Server, field: str, name: str) -> None:
    error = await refused(server, **{"monitor": "m1", "spec": "pair"} | {field: name})
    assert error["code"] == "bad_attach"
    assert error["message"].startswith(f"{field}: {name!r} is no name here: one has ")
    assert "letters of ASCII, digits, `_`, `-`" in error["message"]
    assert "pattern" not in error["message"]


def test_what_is_no_name_over_http_is_told_what_a_name_has(server: Server) -> None:
    refusal = problem(server.http.post("/api/v1/sessions", json={"spec": "pair", "id": "a flight"}), 422)
    assert refusal["detail"].startswith(
        "body.id: 'a flight' is no name here: one has 1 to 64 letters of ASCII, digits,"
    )


async def test_a_refused_attach_leaves_no_session_behind(start: Starts) -> None:
    server = start(ORACLE_RESUME_WITHIN="0.05")
    assert (await refused(server, spec="pair", streams=["/nowhere"]))["code"] == "bad_attach"
    async with attached(server, spec="pair") as other:
        session = other.attached["session"]
        await other.detach()
    await server.until(lambda: server.get(f"sessions/{session}")["status"], lambda status: status == "closed")
    assert [s["id"] for s in server.get("sessions")["items"] if s["id"] != session and s["status"] == "open"] == []


async def test_two_sessions_share_nothing(server: Server, name: Callable[[], str]) -> None:
    one, two = name(), name()
    async with (
        attached(server, "m1", session=one, spec="pair", streams=["/a", "/b"]) as first,
        attached(server, "m1", session=two, spec="pair", streams=["/a", "/b"]) as second,
    ):
        await first.send(make_event(1, "/a", at=10, data={"id": 7, "v": 0}))
        await first.send(make_clock("/b", at=10))
        await first.acked(1)
        await second.send(make_clock("/a", at=30))
        await second.send(make_event(1, "/b", at=20, data={"id": 7}))
        await second.acked(1)
        await second.violated(1)
        await first.violated(1)
        await first.send(make_event(2, "/b", at=20, data={"id": 7}), make_clock("/a", at=30))
        await first.acked(2)
        assert {v["property"] for v in first.violations} == {"never_zero"}
        assert {v["property"] for v in second.violations} == {"b_after_a"}
    b_after_a = {"property": "b_after_a", "stream": "/b"}
    assert [r["outcome"] for r in server.records(one, **b_after_a)] == ["currently_true"]
    assert [r["outcome"] for r in server.records(two, **b_after_a)] == ["currently_false"]
    assert {r["outcome"] for r in server.records(one, property="never_zero")} == {"false"}
    assert {r["outcome"] for r in server.records(two, property="never_zero")} == {"currently_true"}
    assert [r["seq"] for r in server.records(two, property="b_after_a")] == [1]


async def test_a_connection_of_the_same_process_replaces_the_old_one(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as old:
        await old.send(make_event(1, data={"v": 1}))
        await old.acked(1)
        async with attached(server, session=session, streams=["/a"]) as new:
            frames, code = await old.closed()
            assert code == 1008
            assert [(f["type"], f.get("code")) for f in frames] == [("error", "replaced")]
            assert new.attached["next"] == 2
            await new.send(make_event(2, at=1, data={"v": 1}))
            await new.acked(2)
            assert monitors(server, session)["m1"]["connected"]
    assert judged(server, session) == [("m1", "/a", 1), ("m1", "/a", 2)]


async def test_another_process_of_the_name_takes_over_once_the_connection_is_lost(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as old:
        await old.send(make_event(1, data={"v": 1}))
        await old.acked(1)
        assert (await refused(server, session=session, instance="m1-2"))["code"] == "monitor_taken"
        await old.send(make_event(2, at=1, data={"v": 1}))
        await old.acked(2)
        old.vanish()
    await server.until(lambda: monitors(server, session)["m1"], lambda m: not m["connected"])
    async with attached(server, session=session, instance="m1-2", streams=["/a"]) as new:
        assert new.attached["next"] == 3
        await new.send(make_event(3, at=2, data={"v": 1}))
        await new.acked(3)
    assert [r["degraded"] for r in server.records(session, property="a_is_small")] == [False] * 3


@pytest.mark.parametrize("behind_a_proxy", [False, True])
async def test_another_process_of_the_name_takes_over_where_the_old_one_is_not_reached(
    behind_a_proxy: bool, server: Server, session: str
) -> None:
    """A robot that was switched off says nothing of it, and a proxy takes what is sent to it all the same."""
    async with attached(server, session=session, spec="pair", streams=["/a"]) as old:
        await old.send(make_event(1, data={"v": 1}))
        await old.acked(1)
        if behind_a_proxy:
            old.socket.transport.pause_reading()
        else:
            old.lose_network()
        async with attached(server, session=session, instance="m1-2", streams=["/a"]) as new:
            assert new.attached["next"] == 2
            await new.send(make_event(2, at=1, data={"v": 1}))
            await new.acked(2)
            old.vanish()
    assert judged(server, session) == [("m1", "/a", 1), ("m1", "/a", 2)]


async def test_a_new_process_loses_none_of_its_events_to_those_that_the_old_one_left_waiting(
    server: Server, session: str
) -> None:
    """What the old process sent is still held: the new one knows nothing of it, and goes on at `next`."""
    async with attached(server, "other", session=session, spec="pair", streams=["/b"]) as other:
        async with attached(server, session=session, streams=["/a"]) as old:
            await old.send(make_events(make_event(1, at=10, data={"v": 1}), make_event(2, at=20, data={"v": 2})))
            await server.holds(session, 2)
            old.vanish()
        await server.until(lambda: monitors(server, session)["m1"], lambda m: not m["connected"])
        async with attached(server, session=session, instance="m1-2", streams=["/a"]) as new:
            following = new.attached["next"]
            await new.send(make_event(following, at=30, data={"v": 3}), make_event(following + 1, at=40, data={"v": 4}))
            await new.send(make_clock("/a", at=100))
            await other.send(make_clock("/b", at=100))
            await new.acked(following + 1)
    ms = [(r["stamp"] // 10**6) % 1000 for r in server.records(session, property="a_is_small")]
    assert ms == [10, 20, 30, 40]


async def test_a_session_keeps_the_spec_that_it_was_opened_with(start: Starts) -> None:
    server = start()
    path = server.specs / "single.yaml"
    async with attached(server, session="old", spec="single") as old:
        path.write_text(path.read_text().replace("v > 10", "v > 5"))
        async with attached(server, session="new", spec="single") as new:
            assert new.attached["spec_digest"] != old.attached["spec_digest"]
            for monitor in (old, new):
                await monitor.send(make_event(1, data={"v": 7}))
                await monitor.acked(1)
            async with attached(server, "m2", session="old", spec="single") as joined:
                assert joined.attached["spec_digest"] == old.attached["spec_digest"]
                await joined.send(make_event(1, at=1, data={"v": 7}))
                await joined.acked(1)
    assert [r["outcome"] for r in server.records("old")] == ["currently_true"] * 2
    assert [r["outcome"] for r in server.records("new")] == ["currently_false"]
    digests = {s["id"]: s["spec_digest"] for s in server.get("sessions")["items"]}
    assert server.stop() == 0

    server = start()
    assert {s["id"]: s["spec_digest"] for s in server.get("sessions")["items"]} == digests
    async with attached(server, session="old", spec="single") as old:
        await old.send(make_event(2, at=2, data={"v": 7}))
        await old.acked(2)
    assert [r["outcome"] for r in server.records("old")] == ["currently_true"] * 3


async def test_a_spec_that_has_become_unsound_opens_no_session_and_ends_none(start: Starts) -> None:
    server = start()
    async with attached(server, session="old", spec="single") as old:
        (server.specs / "single.yaml").write_text("id: single\nstreams: 7\n")
        error = await refused(server, monitor="m2", session="new", spec="single")
        assert error["code"] == "bad_spec"
        assert "single.yaml:2:10" in error["message"]
        await old.send(make_event(1, data={"v": 7}))
        await old.acked(1)
    assert {s["id"] for s in server.get("sessions")["items"]} == {"old"}


async def test_a_server_with_unsound_files_serves_the_others(start: Starts) -> None:
    server = start()
    single = server.specs / "single.yaml"
    sound = single.read_text()
    assert server.stop() == 0
    single.write_text("id: single\n")
    (server.specs / "zz.yaml").write_text(sound.replace("id: single", "id: pair"))
    server = start()
    listed = [(s["id"], s.get("problem", "")) for s in server.get("specs")["items"]]
    assert [reason for spec_id, reason in listed if spec_id == "single" and reason.startswith(f"{single}:1:1: ")]
    assert [reason for spec_id, reason in listed if spec_id == "pair" and "is that of" in reason]
    table = run("specs", "--url", server.url).stdout
    assert "unsound: " in table
    problem(server.http.post("/api/v1/sessions", json={"spec": "single"}), 422)
    assert (await refused(server, spec="single"))["code"] == "bad_spec"
    assert server.http.post("/api/v1/sessions", json={"spec": "pair"}).status_code == 201
    single.write_text(sound)
    assert server.http.post("/api/v1/sessions", json={"spec": "single"}).status_code == 201
    assert "problem" not in server.get("specs/single")
