"""Robots as the pictures in docs/ show them: a fleet in which one drives too fast, and one has lost its scanner."""

from __future__ import annotations

import math
from collections.abc import AsyncIterator, Iterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

from tests.whole.client import Monitor, attached, make_events
from tests.whole.harness import Server

FOLDER = Path(__file__).parent
LONG = 80
"""Seconds of each robot's life."""
_TIMES_A_SECOND = {"/cmd_vel": 10, "/odom": 15, "/scan": 10, "/emergency_stop": 2, "/mode": 1}
_TOGETHER = 500
_ROBOTS = {"amr-07": ("fast", "blind"), "amr-11": ("near",), "amr-15": ("blind",), "amr-22": ("far",)}
_FINE = ("amr-01", "amr-03", "amr-04", "arm-01", "arm-02")


@asynccontextmanager
async def played(server: Server, until: int) -> AsyncIterator[None]:
    """All robots, whose lives end at `until` (ns); those with a fault stay attached."""
    for name in _FINE:
        async with _live(server, name, (), until, LONG // 8) as monitor:
            monitor.vanish()
    server.http.delete(f"/api/v1/sessions/{_FINE[-1]}")
    async with AsyncExitStack() as monitors:
        for name, faults in _ROBOTS.items():
            monitor = await monitors.enter_async_context(_live(server, name, faults, until, LONG))
            monitors.callback(monitor.vanish)
        yield


@asynccontextmanager
async def _live(server: Server, name: str, faults: tuple[str, ...], until: int, long: int) -> AsyncIterator[Monitor]:
    """One robot, once so many seconds of its life are judged."""
    events = [*_events(faults, until, long)]
    async with attached(server, "robot", session=name, spec="nav", streams=[*_TIMES_A_SECOND]) as monitor:
        for start in range(0, len(events), _TOGETHER):
            await monitor.send(make_events(*events[start : start + _TOGETHER]))
            await monitor.acked(start - _TOGETHER)  # the newest ones wait for the streams that are slow
        stamps = [{"stream": each, "kind": "topic", "stamp": until} for each in _TIMES_A_SECOND]
        await monitor.send({"type": "clock", "stamps": stamps})
        await monitor.acked(len(events))
        yield monitor


def _events(faults: tuple[str, ...], until: int, long: int) -> Iterator[dict[str, Any]]:
    begin = until - long * 10**9
    times = sorted((i / rate, stream) for stream, rate in _TIMES_A_SECOND.items() for i in range(long * rate))
    seq = 0
    for at, stream in times:
        data = _message(stream, at, long - at, faults)
        if data is None:
            continue
        seq += 1
        ask = {"ask": True} if stream == "/cmd_vel" else {}
        yield {
            "type": "event", "seq": seq, "stream": stream, "kind": "topic",
            "stamp": begin + round(at * 10**9), "data": data, **ask,
        }  # fmt: skip


def _message(stream: str, at: float, left: float, faults: tuple[str, ...]) -> dict[str, Any] | None:
    """What a node says `at` seconds after the begin and `left` before the end; None where it is silent."""
    cmd = 0.55 + 0.3 * math.sin(at / 6) + 0.02 * math.sin(at * 5)
    if "fast" in faults and left < 19:
        cmd = 1.42
    ahead = 2.4 + 1.1 * math.cos(at / 9)
    if "near" in faults and 60 < left < 63:
        ahead, cmd = 0.6, 0.7
    match stream:
        case "/cmd_vel":
            return {"linear": {"x": round(cmd, 3)}}
        case "/odom":
            fast = "far" in faults and 30 < left < 34
            return {"twist": {"twist": {"linear": {"x": 1.3 if fast else round(min(cmd, 1.0) * 0.97, 3)}}}}
        case "/scan":
            return None if "blind" in faults and 64 < left < 67 else {"ahead": round(ahead, 3)}
        case "/emergency_stop":
            return {"data": False}
    return {"data": "auto"}
