"""A session by time, on a server that is killed at any moment and goes on."""

from __future__ import annotations

import asyncio
import json
import random
import signal
from collections import Counter
from collections.abc import AsyncIterator
from typing import Any

import pytest

from tests.whole.client import BASE, attached, make_clock, make_event, make_events
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, problem
from tests.whole.test_stream import stream


def compare(server: Server, session: str) -> None:
    """Hold the timeline of a session, whole and in part, against its records."""
    records = server.records(session, property="a_is_small")
    whole = server.get(f"sessions/{session}/timeline", buckets=7)
    assert whole["position"] == len(records)
    middle = {"since": records[len(records) // 3]["stamp"], "until": records[len(records) // 2]["stamp"]}
    part = server.get(f"sessions/{session}/timeline", buckets=50, **middle)
    for found in (whole, part):
        until = found["since"] + found["buckets"] * found["width"]
        inside = [r for r in records if found["since"] <= r["stamp"] < until]
        assert sum(found["steps"]) == len(inside)
        assert sum(found["violations"]["a_is_small"]) == sum(r["violation"] for r in inside)
        assert sum(found["streams"]["/a"]["count"]) == len(inside)
        told = Counter(found["lanes"]["a_is_small"])
        assert told["f"] == 0 if all(r["outcome"] == "currently_true" for r in inside) else told["f"] > 0


@pytest.mark.parametrize("seed", range(1))
async def test_what_is_told_after_kills_is_what_the_records_come_to(start: Starts, seed: int) -> None:
    rng = random.Random(seed)
    server, seq = start(), 0
    for kill in range(4):
        async with attached(server, session="s", spec="single") as monitor:
            seq = monitor.attached["next"] - 1
            for _ in range(rng.randrange(1, 5)):
                events = []
                for _ in range(rng.randrange(1, 90)):
                    seq += 1
                    events.append(make_event(seq, at=seq * 10, data={"v": 30 if rng.random() < 0.05 else 3}))
                await monitor.send(make_events(*events), make_clock("/a", seq * 10 + 1))
                if rng.random() < 0.5:
                    await monitor.acked(seq - rng.randrange(len(events)))
            if kill < 3:
                server.stop(signal.SIGKILL)
                server = start()
            else:
                await monitor.acked(seq)
    compare(server, "s")
    assert server.http.delete("/api/v1/sessions/s").status_code == 200
    compare(server, "s")


async def told(events: AsyncIterator[dict[str, str]], position: int) -> dict[str, Any]:
    """What a stream tells once it has got to a position."""
    async with asyncio.timeout(PATIENCE):
        async for event in events:
            found: dict[str, Any] = json.loads(event["data"])
            assert event["id"] == str(found["position"])
            if found["position"] == position:
                return found
    raise AssertionError(f"it ended before {position}")


async def test_a_stream_tells_whole_buckets_that_have_changed(server: Server, session: str) -> None:
    second = 10**9
    async with attached(server, session=session, spec="single") as monitor:
        events = [make_event(seq, at=seq * 100, data={"v": 3}) for seq in range(1, 101)]
        await monitor.send(make_events(*events[:95]), make_clock("/a", 9501))
        await monitor.acked(95)
        async with stream(server, session, "timeline/stream", width=second, after=94) as live:
            found = await told(live, 95)
            assert (found["since"], found["steps"]) == (BASE + 9 * second, [6])
            await monitor.send(make_events(*events[95:]), make_clock("/a", 10_001))
            found = await told(live, 100)
            assert (found["since"], found["steps"]) == (BASE + 9 * second, [10, 1])
            await monitor.detach()
            assert server.http.delete(f"/api/v1/sessions/{session}").status_code == 200
            async with asyncio.timeout(PATIENCE):
                rest = [event async for event in live]
    assert [event.get("event") for event in rest] == ["closed"]
    async with stream(server, session, "timeline/stream", 99, width=10 * second) as again:
        assert (await told(again, 100))["steps"] == [1]


def test_a_width_that_no_timeline_has_is_refused(server: Server, session: str) -> None:
    server.http.post("/api/v1/sessions", json={"spec": "single", "id": session})
    answer = server.http.get(f"/api/v1/sessions/{session}/timeline/stream", params={"width": 300})
    assert "1, 2 or 5 times a power of ten" in problem(answer, 422)["detail"]
