"""The events around a moment, and the parts of a formula at it, over HTTP."""

from __future__ import annotations

from typing import Any

import pytest

from tests.whole.client import BASE, attached, make_clock, make_event
from tests.whole.harness import Server, problem

STREAMS = ["/odom", "/chat"]


@pytest.fixture
async def told(server: Server, session: str) -> str:
    """A session in which a command is denied, one allowed, a service called, and something came late."""
    async with attached(server, session=session, spec="office") as monitor:
        await monitor.send(
            make_event(1, "/odom", at=10, data={"speed": 1}, source="/base"),
            make_event(2, "/dock", at=20, kind="request", call=4, data={"bay": 2}),
            make_event(3, "/dock", at=30, kind="response", call=4, data={"ok": True}),
            make_event(4, "/chat", at=31, data={"text": "x" * 500}, source="/talker"),
        )
        await monitor.send(*clocks(40))
        denied = await monitor.ask(5, stream="/cmd", at=35, data={"v": 11}, source="/pilot")
        assert denied["decision"] == "deny"
        await monitor.send(make_event(6, "/odom", at=15, data={"speed": 0}))
        await monitor.acked(6)
    return session


def clocks(at: float) -> list[dict[str, Any]]:
    return [
        *(make_clock(stream, at) for stream in STREAMS),
        make_clock("/dock", at, "request"),
        make_clock("/dock", at, "response"),
    ]


async def test_events_are_told_with_senders_decisions_and_calls(server: Server, told: str) -> None:
    found = server.get(f"sessions/{told}/sequence")
    assert (found["earlier"], found["later"], found["left_out"]) == (None, None, 0)
    items = found["items"]
    assert [(i["stream"], i["kind"], i["stamp"] - BASE) for i in items] == [
        ("/odom", "topic", 10_000_000),
        ("/dock", "request", 20_000_000),
        ("/dock", "response", 30_000_000),
        ("/chat", "topic", 31_000_000),
        ("/cmd", "topic", 35_000_000),
        ("/odom", "topic", 15_000_000),
    ]
    odom, request, response, chat, cmd, late = items
    assert (odom["source"], odom["signals"], odom["asked"], odom["decision"]) == ("/base", {"speed": 1}, False, None)
    assert request["call"] == response["call"] == 4
    assert request["violated"] == [{"property": "docks_still", "n": 4}]
    assert (request["n"], request["outcome"]) == (4, "currently_false"), "the gravest"
    assert chat["signals"] == {"text": "x" * 100 + "…"}
    assert (cmd["asked"], cmd["decision"], cmd["denied_by"]) == (True, "deny", ["cmd_small"])
    assert cmd["held"] >= 0
    assert (late["late"], late["source"]) == (True, "")


async def test_they_are_paged_along_time_and_narrowed_to_a_property(server: Server, told: str) -> None:
    address = f"sessions/{told}/sequence"
    last = server.get(address, limit=2)
    assert [i["seq"] for i in last["items"]] == [5, 6]
    before = server.get(address, limit=3, before=last["earlier"])
    assert [i["seq"] for i in before["items"]] == [2, 3, 4]
    first = server.get(address, limit=3, before=before["earlier"])
    assert [i["seq"] for i in first["items"]] == [1]
    assert first["earlier"] is None
    assert [i["seq"] for i in server.get(address, limit=3, after=first["later"])["items"]] == [2, 3, 4]
    around = server.get(address, limit=3, at=BASE + 30_000_000)
    assert [i["seq"] for i in around["items"]] == [2, 3, 4]
    assert [i["seq"] for i in server.get(address, limit=3, n=5)["items"]] == [2, 3, 4]
    narrow = server.get(address, property="cmd_small")
    assert [i["seq"] for i in narrow["items"]] == [5]
    assert narrow["left_out"] == 5
    assert narrow["items"][0]["n"] == 9


async def test_places_that_are_not_there_are_refused(server: Server, told: str) -> None:
    address = f"/api/v1/sessions/{told}/sequence"
    assert "no verdict 1000" in problem(server.http.get(address, params={"n": 1000}), 404)["detail"]
    assert "no property `x`" in problem(server.http.get(address, params={"property": "x"}), 422)["detail"]
    assert "give one of" in problem(server.http.get(address, params={"n": 1, "at": 1}), 422)["detail"]
    problem(server.http.get(address, params={"limit": 201}), 422)


async def test_the_parts_of_a_formula_are_told_around_a_verdict(server: Server, told: str) -> None:
    found = server.get(f"sessions/{told}/verdicts/4/parts")
    assert (found["property"], found["at"], found["note"]) == ("docks_still", 1, None)
    assert found["times"][0] == BASE + 10_000_000
    assert found["numbers"] == [2, 4, 6, 8, 10, 12]
    assert found["outcomes"] == [[0, "currently_true"], [1, "currently_false"], [2, "currently_true"]]
    rows = {(part["depth"], part["head"]): part for part in found["parts"]}
    assert rows[0, "->"]["runs"] == [[0, "holds"], [1, "fails"], [2, "holds"]]
    assert rows[2, "pre"]["runs"][:3] == [[0, "fails"], [1, "holds"], [2, "fails"]]
    atom = rows[3, '{topic: "/odom", speed > 0}']
    assert atom["runs"] == [[0, "holds"], [1, "fails"]]
    assert (atom["signal"], atom["values"]) == ("speed", [[0, 1], [1, None], [5, 0]])
    near = server.get(f"sessions/{told}/verdicts/4/parts", within=10_000_000)
    assert near["numbers"] == [2, 4, 6]
    few = server.get(f"sessions/{told}/verdicts/4/parts", steps=0)
    assert (few["numbers"], few["earlier"], few["later"]) == ([4], True, True)
    problem(server.http.get(f"/api/v1/sessions/{told}/verdicts/1000/parts"), 404)


async def test_an_engine_that_tells_no_parts_says_so(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="robust") as monitor:
        await monitor.send(make_event(1, at=1, data={"v": 1}), make_event(2, at=2, data={"v": 20}))
        await monitor.acked(2)
    found = server.get(f"sessions/{session}/verdicts/4/parts")
    assert (found["property"], len(found["parts"])) == ("small", 1)
    assert found["note"] == "engine 'rtamt' does not tell the parts of its formulas: only the outcome is shown"
    assert found["parts"][0]["runs"] == [[0, "holds"], [1, "fails"]]
    assert found["robustness"] == [2, -17]
