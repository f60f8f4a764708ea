"""Actions from outside: goals that are denied, restarts within a goal, several monitors, ids that repeat or are odd."""

from __future__ import annotations

import json
import signal
from pathlib import Path
from typing import Any

import pytest

from tests.whole.client import BASE, Frame, Monitor, attached, make_event, make_events, stable
from tests.whole.conftest import Starts
from tests.whole.harness import Server, run

ASKED = ("goal", "reply", "cancel", "result")
ODD = [
    "", "0" * 32, "NaN", "Infinity", "null", "g" * 255, "a'b\"c\\d", "{x}", "line\nbreak\t\x00", "☃ π 目標", "*",
    "status", "<script>alert(1)</script>",
]  # fmt: skip
"""Ids that nobody should send, and that any client may choose."""


def clock(at: float) -> Frame:
    """The clocks of all ordered streams of the spec, `at` ms after `BASE`."""
    stamps = [{"stream": "/drive", "kind": kind, "stamp": BASE + round(at * 10**6)} for kind in ASKED]
    return {"type": "clock", "stamps": [{"stream": "/arm", "stamp": BASE + round(at * 10**6)}, *stamps]}


def arm(seq: int, at: float, *, stowed: bool) -> Frame:
    return make_event(seq, "/arm", at, {"stowed": stowed})


def goal(seq: int, at: float, goal_id: str, **more: Any) -> Frame:
    return make_event(seq, "/drive", at, {"x": 1.0}, kind="goal", goal_id=goal_id, **more)


def reply(seq: int, at: float, goal_id: str, *, accepted: bool = True) -> Frame:
    status = "accepted" if accepted else "rejected"
    return make_event(seq, "/drive", at, {"accepted": accepted}, kind="reply", goal_id=goal_id, status=status)


def result(seq: int, at: float, goal_id: str, status: str = "succeeded", **more: Any) -> Frame:
    return make_event(seq, "/drive", at, {"code": 0}, kind="result", goal_id=goal_id, status=status, **more)


def outcomes(server: Server, session: str, kind: str, **query: Any) -> list[tuple[int, str]]:
    found = server.records(session, property="results_have_goals", **query)
    return [(record["seq"], record["outcome"]) for record in found if record["kind"] == kind]


def observing(session: str | None = None, **fields: Any) -> dict[str, Any]:
    return {"session": session, "spec": "errand", "features": ["actions"], **fields}


async def drive(monitor: Monitor) -> None:
    """A goal that is done, and a result of one that nobody sent."""
    await monitor.send(arm(1, 1, stowed=True), goal(2, 2, "a", ask=True), clock(3))
    await monitor.expect("decision", seq=2, decision="allow")
    await monitor.send(reply(3, 4, "a"), result(4, 5, "a"), result(5, 6, "b", "aborted"), clock(7))
    await monitor.acked(5)


async def test_a_goal_is_denied_by_name_and_explained_by_its_id(server: Server, session: str) -> None:
    async with attached(server, **observing(session)) as monitor:
        await monitor.send(arm(1, 1, stowed=False), goal(2, 2, "9f2c", ask=True), clock(3))
        decision = await monitor.expect("decision", seq=2)
        assert (decision["decision"], decision["denied_by"]) == ("deny", ["arm_is_stowed"])
        (violation,) = await monitor.violated(1)
        assert violation["explanation"]["event"]["signals"]["goal_id"] == "9f2c"
        assert violation["explanation"]["event"]["kind"] == "goal"


async def test_a_session_goes_on_within_a_goal_where_the_server_dies(start: Starts) -> None:
    server = start()
    async with attached(server, **observing("s")) as monitor:
        await monitor.send(arm(1, 1, stowed=False), clock(2))
        await monitor.acked(1)
        await monitor.send(arm(2, 3, stowed=True), goal(3, 4, "a", ask=True), reply(4, 5, "a"), clock(6))
        await monitor.acked(4)
        await monitor.send(goal(5, 8, "b", ask=True))
        await server.holds("s", 1)
        server.stop(signal.SIGKILL)
    server = start()
    async with attached(server, **observing("s")) as monitor:
        assert monitor.attached["next"] == 5
        await monitor.send(goal(5, 8, "b", ask=True), clock(9))
        assert (await monitor.expect("decision", seq=5))["decision"] == "allow", "the arm is held over the restart"
        await monitor.send(result(6, 10, "a"), result(7, 11, "b"), clock(12))
        await monitor.acked(7)
    assert outcomes(server, "s", "result") == [(6, "currently_true"), (7, "currently_false")], "b has no reply"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
async def test_the_records_and_the_trace_of_a_restored_session_are_the_same(
    start: Starts, number: signal.Signals, tmp_path: Path
) -> None:
    server = start()
    async with attached(server, **observing("s")) as monitor:
        await drive(monitor)
        before, lines = server.records("s"), trace(server, "s")
        server.stop(number)
    server = start()
    assert server.records("s") == before
    assert trace(server, "s") == lines
    assert [(line["kind"], line.get("goal_id"), line.get("status")) for line in lines] == [
        ("topic", None, None), ("goal", "a", None), ("reply", "a", "accepted"), ("result", "a", "succeeded"),
        ("result", "b", "aborted"),
    ]  # fmt: skip
    path, spec = tmp_path / "trace.jsonl", Path(__file__).parents[1] / "vectors" / "specs" / "errand.yaml"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    *replayed, _ = map(json.loads, run("replay", spec, path, "--json").stdout.splitlines())
    assert stable(replayed) == stable(before)


def trace(server: Server, session: str) -> list[dict[str, Any]]:
    text = server.http.get(f"/api/v1/sessions/{session}/trace").text
    return [json.loads(line) for line in text.splitlines()]


async def test_two_monitors_observe_one_action_each_with_calls_and_goals_of_its_own(
    server: Server, session: str
) -> None:
    async with (
        attached(server, "m1", **observing(session)) as first,
        attached(server, "m2", **observing(session)) as second,
    ):
        await first.send(arm(1, 1, stowed=True), goal(2, 2, "a", call=1, ask=True))
        await second.send(goal(1, 2, "b", call=1, ask=True))
        for monitor in (first, second):
            await monitor.send(clock(3))
        assert (await first.expect("decision", seq=2))["decision"] == "allow"
        assert (await second.expect("decision", seq=1))["decision"] == "deny", "each holds the arm that it saw itself"
        await first.send(reply(3, 4, "a"), clock(8))
        await second.send(result(2, 5, "a"), clock(8))
        await first.acked(3)
        await second.acked(2)
    assert outcomes(server, session, "result") == [(2, "currently_true")]


async def test_an_id_that_comes_again_is_one_id(server: Server, session: str) -> None:
    async with attached(server, **observing(session)) as monitor:
        await monitor.send(arm(1, 1, stowed=True), clock(2))
        for n in range(3):
            await monitor.send(goal(3 * n + 2, 10 * n + 3, "a", ask=True), clock(10 * n + 4))
            assert (await monitor.expect("decision", seq=3 * n + 2))["decision"] == "allow"
            await monitor.send(reply(3 * n + 3, 10 * n + 5, "a"), result(3 * n + 4, 10 * n + 6, "a"))
        await monitor.send(clock(100))
        await monitor.acked(10)
    assert [outcome for _, outcome in outcomes(server, session, "result")] == ["currently_true"] * 3


async def test_an_odd_id_is_a_text_like_any_other(start: Starts) -> None:
    server = start()
    async with attached(server, **observing("s")) as monitor:
        events = [reply(n, n, goal_id) for n, goal_id in enumerate(ODD, start=1)]
        events += [result(n + len(ODD), n + len(ODD), goal_id) for n, goal_id in enumerate(ODD, start=1)]
        events.append(result(2 * len(ODD) + 1, 2 * len(ODD) + 1, "another"))
        await monitor.send(make_events(*events), clock(1000))
        await monitor.acked(len(events))
        server.stop(signal.SIGKILL)
    server = start()
    found = [outcome for _, outcome in outcomes(server, "s", "result")]
    assert found == ["currently_true"] * len(ODD) + ["currently_false"]
    assert [line["goal_id"] for line in trace(server, "s")][: len(ODD)] == ODD


async def test_what_a_monitor_may_not_say_of_a_goal_is_refused_and_the_rest_is_judged(
    server: Server, session: str
) -> None:
    async with attached(server, **observing(session)) as monitor:
        wrong = [goal(1, 1, "g" * 256), goal(2, 2, None), result(3, 3, "a", "done"), goal(4, 4, ["a"])]  # type: ignore[arg-type]
        wrong.append(make_event(5, "/drive", 5, kind="gaol", goal_id="a"))
        await monitor.send(make_events(*wrong, arm(6, 6, stowed=True)), clock(7))
        refused = [await monitor.expect("error", seq=seq) for seq in range(1, 6)]
        assert {error["code"] for error in refused} == {"bad_event"}
        assert not any(error["fatal"] for error in refused)
        await monitor.acked(6)
    assert {record["seq"] for record in server.records(session)} == {6}
