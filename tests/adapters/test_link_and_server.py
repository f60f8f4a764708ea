"""The link against the real server: events, asks and outcomes."""

from __future__ import annotations

from oracle_adapter import Link, should_pass

from tests.server.conftest import Starts
from tests.server.harness import PATIENCE

STAMP = 1_732_147_200 * 10**9
EVENTS = 300


async def test_events_and_decisions_are_in_the_history_each_once(start: Starts) -> None:
    server = start()
    link = Link(server.url, "m1", spec="single", session="s", streams=["/a"])
    with link:
        link.wait_attached(PATIENCE)
        for i in range(EVENTS):
            assert link.send("/a", "topic", STAMP + i, {"v": 1})
        answer = link.ask("/a", "topic", STAMP + EVENTS, {"v": 99}, decide_within=PATIENCE).result(PATIENCE)
        assert answer.why == "decision"
        link.outcome(answer, *should_pass(answer, "deny"))
        assert link.close(PATIENCE)
    records = server.records("s")
    first = [r for r in records if r["property"] == records[0]["property"]]
    assert [r["seq"] for r in first] == list(range(1, EVENTS + 2))
    assert (first[-1]["decision"], first[-1]["passed"]) == (answer.decision, answer.decision == "allow")
    assert link.stats().lost == 0
