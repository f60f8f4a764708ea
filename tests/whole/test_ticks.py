"""Deadlines that run out in a served session."""

from __future__ import annotations

import asyncio
import signal
import time

from tests.whole.client import BASE, attached, make_clock, make_event
from tests.whole.conftest import Starts


async def test_a_deadline_that_runs_out_is_told_recorded_and_known_after_a_restart(start: Starts) -> None:
    server = start()
    async with attached(server, session="s", spec="timed") as monitor:
        await monitor.send(make_event(1, "/a", at=0), make_clock("/a", 60), make_clock("/b", 60))
        (told,) = await monitor.violated(1)
        assert (told["kind"], told["step"], told["stamp"]) == ("tick", None, BASE + 50 * 10**6)
        await monitor.send(make_event(2, "/b", at=70), make_clock("/a", 80))
        await monitor.acked(2)
    before = server.records("s")
    assert [(r["n"], r["kind"], r["property"], r["outcome"]) for r in before] == [
        (1, "topic", "answered", "currently_true"),
        (2, "topic", "steps", "currently_true"),
        (3, "tick", "answered", "currently_false"),
        (4, "tick", "steps", "currently_true"),
        (5, "topic", "answered", "true"),
        (6, "topic", "steps", "currently_true"),
    ]
    assert server.stop() == 0
    server = start()
    assert server.records("s") == before
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 3
        await monitor.send(make_event(3, "/b", at=90), make_clock("/a", 90))
        await monitor.acked(3)
    after = server.records("s")[len(before) :]
    assert [(r["step"], r["outcome"]) for r in after] == [(3, "true"), (3, "currently_false")]


async def test_what_was_said_in_time_while_the_server_was_away_is_in_time(start: Starts) -> None:
    server = start()
    said = time.time_ns()
    begun = (said - BASE) / 10**6  # ms
    async with attached(server, session="s", spec="answered") as monitor:
        await monitor.send(make_event(1, "/a", at=begun), make_clock("/a", begun + 1), make_clock("/b", begun + 1))
        await monitor.acked(1)
        assert server.stop(signal.SIGKILL) != 0
    while time.time_ns() < said + 4_600_000_000:  # the deadline, and all that it waits where nobody was away
        await asyncio.sleep(0.1)
    server = start()
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(2, "/b", at=begun + 400), make_clock("/a", begun + 401))
        await monitor.acked(2)
    assert [(r["kind"], r["outcome"]) for r in server.records("s")] == [("topic", "currently_true"), ("topic", "true")]
