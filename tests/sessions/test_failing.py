"""Where judging itself fails, nothing of that session is judged any more, and it says so; what was judged is kept."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator
from pathlib import Path

import pytest

from oracle_server.core.events import Signals, Step
from oracle_server.core.judging.judge import Judge
from oracle_server.core.verdicts import Judged
from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import EventMessage
from tests.processes import PATIENCE
from tests.sessions.making import Kept, Standing, attach, registry

BAD = 13
"""The value at which judging fails."""
TIMELESS = 3
"""The steps behind which a deadline can't be judged."""
SECOND = 10**9
PAIR = """
id: pair
ordering: {max_delay: 100ms}
streams:
  - topic: /a
    signals: {v: msg.v}
  - topic: /go
    action: filter
    signals: {v: msg.v}
properties:
  - id: small
    formula: 'not {v > 20}'
    guards: [/go]
  - id: steady
    time: seconds
    formula: 'once[:1s] {topic: "/a"}'
"""


@pytest.fixture
def clock() -> Standing:
    return Standing()


@pytest.fixture
def history() -> Iterator[MemoryHistory]:
    made = MemoryHistory()
    yield made
    made.close()


@pytest.fixture
async def sessions(history: MemoryHistory, tmp_path: Path, clock: Standing) -> AsyncIterator[Registry]:
    async with asyncio.timeout(PATIENCE):
        yield registry(history, tmp_path, PAIR, clock=clock)


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A judge that fails at an event whose `v` is bad, and at deadlines that run out behind such an event."""
    judge, tick = Judge.judge, Judge.tick

    def judge_or_fail(self: Judge, step: Step, now: int) -> Judged:
        if step.signals.get("v") == BAD:
            raise AssertionError("it can't judge this")
        return judge(self, step, now)

    def tick_or_fail(self: Judge, time: int, now: int, recorded: Signals | None = None) -> Judged | None:
        if self.counters.steps == TIMELESS:
            raise AssertionError("it can't judge the time")
        return tick(self, time, now, recorded)

    monkeypatch.setattr(Judge, "judge", judge_or_fail)
    monkeypatch.setattr(Judge, "tick", tick_or_fail)


async def joined(sessions: Registry, name: str) -> tuple[LiveSession, Monitor, Kept]:
    outbox = Kept()
    return *await sessions.attach(attach(name, "pair"), outbox), outbox


def told(seq: int, stream: str, stamp: int, v: int, *, ask: bool = False) -> EventMessage:
    return EventMessage(seq=seq, stream=stream, stamp=stamp, data={"v": v}, ask=ask)


async def kept(history: MemoryHistory, sessions: Registry, live: LiveSession) -> list[int]:
    """The numbers of the events that the history has."""
    live.ledger.write()
    await sessions.flush()
    return [stored.step.event.seq async for page in history.steps(live.number, 0) for stored in page]


async def assert_in_trouble(sessions: Registry, live: LiveSession, outbox: Kept, why: str) -> None:
    """Its monitor is dropped and not let in again, its state says why, and it can be closed."""
    assert [frame["code"] for frame in outbox.frames if frame["type"] == "error"] == ["internal"]
    assert [frame for frame in outbox.frames if frame["type"] == "decision"] == []
    state = await sessions.state("one")
    assert state is not None
    assert why in state["trouble"]
    with pytest.raises(WireError, match="close it, and open another") as refused:
        await joined(sessions, "one")
    assert (refused.value.code, refused.value.fatal) == ("history_unavailable", True)
    assert await sessions.closed_within(live, PATIENCE)
    closed = await sessions.state("one")
    assert closed is not None
    assert (closed["status"], why in closed["trouble"]) == ("closed", True)


@pytest.mark.usefixtures("broken")
async def test_a_session_that_fails_at_an_event_is_judged_no_more(
    history: MemoryHistory, sessions: Registry, clock: Standing
) -> None:
    live, monitor, outbox = await joined(sessions, "one")
    other, monitor_of_other, _ = await joined(sessions, "two")
    begun = clock.time
    live.ingest(monitor, told(1, "/a", begun, 1))
    clock.time += SECOND
    live.ingest(monitor, told(2, "/a", begun + SECOND, 1))
    live.ingest(monitor, told(3, "/a", begun + SECOND + 1, BAD))
    live.ingest(monitor, told(4, "/go", begun + SECOND + 2, 1, ask=True))
    live.ingest(monitor, told(5, "/go", begun + SECOND + 3, 1, ask=True))
    other.ingest(monitor_of_other, told(1, "/a", begun + SECOND, 1))
    other.ingest(monitor_of_other, told(2, "/go", begun + SECOND + 1, 1))
    assert await kept(history, sessions, live) == [1], "behind the second one there would be a gap"
    assert await kept(history, sessions, other) == [1]
    assert other.keeping.trouble is None
    await assert_in_trouble(sessions, live, outbox, "AssertionError: it can't judge this")


@pytest.mark.usefixtures("broken")
async def test_a_session_that_fails_at_a_deadline_is_judged_no_more(
    history: MemoryHistory, sessions: Registry, clock: Standing
) -> None:
    live, monitor, outbox = await joined(sessions, "one")
    for seq in range(1, TIMELESS + 1):
        live.ingest(monitor, told(seq, "/a", clock.time, 1))
        clock.time += SECOND // 10
    while live.keeping.failed is None:
        clock.time += SECOND // 5  # so that the last event is judged in a turn before
        live._tick()
    assert await kept(history, sessions, live) == [*range(1, TIMELESS + 1)]
    await assert_in_trouble(sessions, live, outbox, "AssertionError: it can't judge the time")
