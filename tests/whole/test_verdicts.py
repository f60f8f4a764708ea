"""Verdicts, decisions and violations as monitors and readers get them."""

from __future__ import annotations

import json
from pathlib import Path

from tests.whole.client import attached, make_clock, make_event, make_events
from tests.whole.harness import Server


async def test_a_violation_is_told_to_all_monitors_as_the_history_has_it(server: Server, session: str) -> None:
    async with (
        attached(server, "m1", session=session, spec="pair", streams=["/a"]) as first,
        attached(server, "m2", session=session, spec="pair", streams=[]) as second,
    ):
        await first.send(make_event(1, data={"v": 11}))
        told = await first.expect("violation")
        assert await second.expect("violation") == told
        await first.send(make_event(2, at=1, data={"v": 101}))
        assert (await first.expect("violation"))["property"] == "stays_small"
    (recorded, _) = server.records(session, "violations")
    assert {"type": "violation", **recorded} == told
    assert [r for r in server.records(session) if r["n"] == told["n"]] == [recorded]


async def test_a_batch_that_fills_a_frame_is_answered_whole(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        event = {"seq": 99_999, "stream": "/a", "data": {}, "ask": True}
        count = monitor.attached["limits"]["max_frame"] // (len(json.dumps(event, separators=(",", ":"))) + 1)
        assert 10_000 < count < monitor.attached["limits"]["max_batch"]
        text = json.dumps(make_events(*(event | {"seq": i} for i in range(1, count + 1))), separators=(",", ":"))
        await monitor.send_text(text)
        for seq in range(1, count + 1):
            await monitor.expect("decision", seq=seq, decision="allow")
        await monitor.acked(count)


async def test_who_leaves_in_the_middle_of_a_trace_keeps_nobody_waiting(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="single") as monitor:
        for first in range(1, 4001, 1000):
            events = [make_event(i, at=i, data={"text": "x" * 500}) for i in range(first, first + 1000)]
            await monitor.send(make_events(*events))
        await monitor.acked(4000)
    for _ in range(5):
        with server.http.stream("GET", f"/api/v1/sessions/{session}/trace") as answer:
            assert next(answer.iter_raw())
    assert server.get(f"sessions/{session}/verdicts", limit=1000)["items"]
    with server.http.stream("GET", f"/api/v1/sessions/{session}/trace") as answer:
        assert len([*answer.iter_lines()]) == 4000


async def test_both_orders_are_judged_side_by_side(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="both") as monitor:
        await monitor.send(make_event(1, "/b", at=20), make_event(2, "/a", at=10), make_clock("/a", at=30))
        await monitor.acked(2)
        (violation,) = await monitor.violated(1)
        assert (violation["order"], violation["seq"]) == ("arrival", 1)
    found = [(r["n"], r["order"], r["step"], r["seq"], r["outcome"]) for r in server.records(session)]
    assert found == [
        (1, "arrival", 1, 1, "currently_false"),
        (2, "arrival", 2, 2, "true"),
        (3, "publication", 1, 2, "true"),
        (4, "publication", 2, 1, "true"),
    ]


async def test_how_properties_stand_is_told_again_after_a_reconnect_and_a_restart(tmp_path: Path) -> None:
    specs = Path(__file__).parent / "specs"
    with Server(specs, tmp_path) as server:
        async with attached(server, session="s", spec="pair", streams=["/a"], verdicts=True) as monitor:
            assert (await monitor.expect("verdicts"))["worst"] == "unknown"
            await monitor.send(make_event(1, data={"v": 101}))
            told = await monitor.expect("verdicts")
        assert told["properties"]["stays_small"] == {
            "outcome": "false", "level": "error", "text": "violated for good", "violations": 1,
            "first_violation": told["properties"]["stays_small"]["first_violation"],
            "first_violation_step": 1, "first_violation_at": 1732147200000000000,
            "episode": {
                "first": told["properties"]["stays_small"]["first_violation"], "began": 1732147200000000000,
                "open": True, "final": True, "count": 1,
            },
        }  # fmt: skip
        async with attached(server, session="s", spec="pair", streams=["/a"], verdicts=True) as monitor:
            assert await monitor.expect("verdicts") == told
        server.stop()
    with Server(specs, tmp_path) as server:
        async with attached(server, session="s", spec="pair", streams=["/a"], verdicts=True) as monitor:
            assert await monitor.expect("verdicts") == told


async def test_latched_and_final_outcomes_stay(server: Server, session: str) -> None:
    async with attached(server, session=session, spec="pair", streams=["/a"]) as monitor:
        for seq, v in enumerate((1, 0, 101, 1, 101, 0), start=1):
            await monitor.send(make_event(seq, at=seq, data={"v": v}))
        await monitor.acked(6)
    outcomes = {p: [r["outcome"] for r in server.records(session, property=p)] for p in ("stays_small", "never_zero")}
    assert outcomes == {
        "stays_small": ["currently_true"] * 2 + ["false"] * 4,
        "never_zero": ["currently_true"] + ["false"] * 5,
    }
    counts = {p["id"]: p["violations"] for p in server.get(f"sessions/{session}")["properties"]}
    assert (counts["stays_small"], counts["never_zero"], counts["a_is_small"]) == (1, 1, 2)
