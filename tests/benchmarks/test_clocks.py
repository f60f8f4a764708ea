"""The simulated clocks of the experiment do what their table says of them."""

from __future__ import annotations

from typing import Any

from benchmarks.paper.clocks import MS, Policy, Simulation
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: two
streams: [{topic: /slow}, {topic: /fast}]
properties: [{id: p, formula: 'once{topic: "/slow"}'}]
"""
START = 1_000_000 * MS


def line(topic: str, seq: int, stamp: int, arrived: int) -> dict[str, Any]:
    times = {"stamp": START + stamp * MS, "arrived": START + arrived * MS}
    return {"stream": topic, "kind": "topic", "seq": seq, "source": topic, **times}


def late(policy: Policy, lines: list[dict[str, Any]]) -> int:
    left = Simulation(parse_spec(SPEC, "").spec, policy).run(lines)
    assert sorted(event.line["seq"] for event in left) == sorted(event["seq"] for event in lines)
    assert all(event.at - event.line["arrived"] <= policy.max_delay for event in left)
    return sum(event.late for event in left)


def flight(slow_delay: int, stalled: range) -> list[dict[str, Any]]:
    """Messages every 40 and every 10 ms; slow ones that are published in the stall come at its end."""
    slow = [(at, stalled.stop if at in stalled else at + slow_delay) for at in range(0, 2000, 40)]
    lines = [line("/slow", n, at, came) for n, (at, came) in enumerate(slow)]
    return lines + [line("/fast", 1000 + n, at, at + 1) for n, at in enumerate(range(0, 2000, 10))]


def test_a_clock_that_waits_while_its_stream_is_silent_makes_fewer_late() -> None:
    lines = flight(1, range(1001, 1400))
    told = late(Policy(latency=20 * MS, max_delay=700 * MS), lines)
    waited = late(Policy(latency=20 * MS, silence=3, max_delay=700 * MS), lines)
    assert 0 < waited < told < 10


def test_a_measured_latency_is_that_of_the_messages() -> None:
    lines = flight(60, range(0))
    told = late(Policy(latency=20 * MS), lines)
    assert told > 40
    assert late(Policy(latency=20 * MS, measured=200 * MS), lines) < 5
    assert late(Policy(latency=20 * MS, measured=20 * MS), lines) == told
    assert late(Policy(latency=70 * MS), lines) == 0
