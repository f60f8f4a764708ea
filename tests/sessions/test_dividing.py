"""What the order of a session releases at once is judged in turns, between which other sessions are judged."""

from __future__ import annotations

import asyncio
from itertools import count, pairwise
from pathlib import Path

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.events import Signals
from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.native.timeline import Timeline
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.query import Query
from oracle_server.sessions.shares import FREE, Shares
from oracle_server.wire.incoming import EventMessage
from tests.history.making import find
from tests.processes import PATIENCE
from tests.sessions.making import Kept, Standing, attach, registry

ORDERED = """
id: ordered
ordering: {by: publication, max_delay: 600s}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - id: p
    formula: 'not {v > 1000}'
"""
HELD = 40


def hurried() -> Shares:
    """Shares of which each look finds that a turn's time was spent."""
    looks = count(step=2 * FREE)
    return Shares(lambda: 0.0, lambda: next(looks))


async def test_what_is_released_at_once_is_judged_in_turns(tmp_path: Path) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, ORDERED, shares=hurried())
    outbox = Kept()
    session, monitor = await sessions.attach(attach("s", "ordered"), outbox)
    counters = session.core.judges["publication"].counters
    for seq in range(1, HELD + 1):
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    assert counters.steps == 0
    session.share.run(session.ingest, monitor, EventMessage(seq=HELD + 1, stream="/b", stamp=HELD, data={"v": 0}))
    steps = [counters.steps]
    async with asyncio.timeout(PATIENCE):
        while counters.steps <= HELD:
            await asyncio.sleep(0)
            steps.append(counters.steps)
    assert max(after - before for before, after in pairwise([0, *steps])) <= 2
    assert session.core.buffer.due is None
    assert await sessions.closed_within(session, PATIENCE)
    history.close()


TIMED = """
id: timed
ordering: {by: arrival}
streams:
  - {topic: /a, signals: {v: msg.v}}
properties:
  - id: p
    time: seconds
    formula: 'historically[1s:2s] {v > 0}'
"""


async def test_deadlines_that_expire_at_once_are_judged_in_turns_and_events_come_behind_them(tmp_path: Path) -> None:
    """Each event has deadlines of its own, which all expire within a microsecond."""
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, TIMED, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "timed"), Kept())
    judge = session.core.judges["arrival"]
    ticks, tick = 0, judge.tick

    def counted(time: int, now: int, recorded: Signals | None = None) -> Judged | None:
        nonlocal ticks
        ticks += 1
        return tick(time, now, recorded)

    judge.tick = counted  # type: ignore[method-assign]
    for seq in range(1, HELD + 1):
        clock.time += 2
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    behind = [session.is_behind]
    clock.time += 10 * SECOND
    behind.append(session.is_behind)
    assert behind == [False, True], "an event would have to wait for all of them"
    done = [ticks]
    async with asyncio.timeout(PATIENCE):
        waiting = asyncio.create_task(session.caught_up())
        while not waiting.done():
            done.append(ticks)
            await asyncio.sleep(0)
    done.append(ticks)
    assert ticks >= HELD
    assert max(after - before for before, after in pairwise(done)) <= 2
    assert await sessions.closed_within(session, PATIENCE)
    history.close()


OWING = """
id: owing
ordering: {by: arrival}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - id: p
    time: seconds
    formula: 'forall[x]. {topic: "/a", v: *x} -> eventually[0:2s] {topic: "/b", v: *x}'
"""


async def test_what_runs_out_at_one_time_is_decided_in_turns_and_told_at_once(tmp_path: Path) -> None:
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, OWING, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "owing"), Kept())
    state = session.core.judges["arrival"].properties[0]

    def send(seq: int, stream: str, value: int) -> None:
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream=stream, stamp=seq, data={"v": value}))

    for seq in range(1, HELD + 1):
        send(seq, "/a", seq)
    clock.time += 10 * SECOND
    session.share.run(session._tick)
    open_ones = [HELD, state.pending or 0]
    assert not session.core.can_be_saved
    async with asyncio.timeout(PATIENCE):
        waiting = asyncio.create_task(session.caught_up())
        while not waiting.done():
            open_ones.append(state.pending or 0)
            await asyncio.sleep(0)
    open_ones.append(state.pending or 0)
    assert max(before - after for before, after in pairwise(open_ones)) <= 2
    assert (open_ones[-1], state.violations, session.core.can_be_saved) == (0, HELD, True)
    send(HELD + 1, "/a", 1)
    clock.time += 10 * SECOND
    session.share.run(session._tick)
    assert await sessions.closed_within(session, PATIENCE)
    found, _ = await find(history, session.record, Query(limit=1000))
    told = [(record["kind"], record["about_count"]) for record in found if record["violation"]]
    assert told == [("tick", HELD), ("tick", 1)]
    history.close()


async def test_an_event_that_comes_meanwhile_is_judged_behind_all_that_has_run_out(tmp_path: Path) -> None:
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, OWING, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "owing"), Kept())
    for seq in range(1, HELD + 1):
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    clock.time += 10 * SECOND
    session.share.run(session._tick)
    answer = EventMessage(seq=HELD + 1, stream="/b", stamp=HELD + 1, data={"v": HELD})
    session.share.run(session.ingest, monitor, answer)
    assert not session.core.is_behind
    assert await sessions.closed_within(session, PATIENCE)
    found, _ = await find(history, session.record, Query(limit=1000))
    assert [(record["kind"], record["about_count"]) for record in found[HELD:]] == [("tick", HELD), ("topic", 0)]
    history.close()


async def test_what_costs_too_much_at_one_time_ends_its_property_alone_though_it_was_begun_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def run_out(_: Timeline, count: int) -> None:
        if count > HELD // 2:
            raise EngineError("its deadlines cost too much")

    monkeypatch.setattr(Timeline, "run_out", run_out)
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, OWING, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "owing"), Kept())
    for seq in range(1, HELD + 1):
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    clock.time += 10 * SECOND
    async with asyncio.timeout(PATIENCE):
        await session.caught_up()
    (state,) = session.core.judges["arrival"].properties
    assert (state.broken, state.outcome, state.failures) == ("its deadlines cost too much", Outcome.UNKNOWN, 1)
    assert session.keeping.trouble is None
    assert await sessions.closed_within(session, PATIENCE)
    found, _ = await find(history, session.record, Query(limit=1000))
    assert [(record["kind"], record["outcome"]) for record in found[HELD:]] == [("tick", "unknown")]
    history.close()


REVISING = """
id: revising
ordering: {late: revise, max_delay: 1s, horizon: 1h}
streams:
  - {topic: /a, signals: {v: msg.v}}
properties:
  - {id: p, formula: 'once {v: 0}'}
"""


async def test_while_steps_are_judged_again_no_event_is_taken(tmp_path: Path) -> None:
    """What waits for a pass would have no bound: the order has let go of it, so that no credit holds it back."""
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, REVISING, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "revising"), Kept())
    for seq in range(1, HELD + 1):
        stamp = seq + 10 if seq < HELD else 1
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=stamp, data={"v": seq}))
    assert session.core.lateness is not None
    assert (session.core.lateness.waiting, session.is_behind) == (1, False)
    clock.time += SECOND
    session.share.run(session._tick)
    assert session.is_behind
    async with asyncio.timeout(PATIENCE):
        await session.caught_up()
    judge = session.core.lateness.judge
    assert (session.is_behind, judge.is_going, judge.counters.steps) == (False, False, HELD)
    assert await sessions.closed_within(session, PATIENCE)
    history.close()


async def test_what_is_held_when_a_session_is_closed_is_judged_in_turns(tmp_path: Path) -> None:
    history = MemoryHistory()
    sessions = registry(history, tmp_path, ORDERED, shares=hurried())
    session, monitor = await sessions.attach(attach("s", "ordered"), Kept())
    counters = session.core.judges["publication"].counters
    for seq in range(1, HELD + 1):
        session.share.run(session.ingest, monitor, EventMessage(seq=seq, stream="/a", stamp=seq, data={"v": seq}))
    assert counters.steps == 0
    closing = asyncio.create_task(sessions.closed_within(session, PATIENCE))
    steps = [0]
    async with asyncio.timeout(PATIENCE):
        while not closing.done():
            await asyncio.sleep(0)
            steps.append(counters.steps)
    assert closing.result()
    assert steps[-1] == HELD
    assert max(after - before for before, after in pairwise(steps)) <= 2
    history.close()


ROWS = """
id: rows
ordering: {late: revise, max_delay: 1s, horizon: 1s}
streams:
  - {topic: /a, each: msg.items, signals: {v: item.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - {id: rising, formula: 'not ({v: 2} and not pre {v: 1})'}
"""


async def test_nothing_that_is_late_is_judged_between_the_rows_of_an_event(tmp_path: Path) -> None:
    """What is too late for its place is judged at the present: behind an event, and not in the midst of it."""
    history, clock = MemoryHistory(), Standing()
    sessions = registry(history, tmp_path, ROWS, shares=hurried(), clock=clock)
    session, monitor = await sessions.attach(attach("s", "rows"), Kept())

    def send(seq: int, stamp: int, *values: int) -> None:
        data = {"items": [{"v": v} for v in values]}
        message = EventMessage(seq=seq, stream="/a", stamp=stamp * SECOND, data=data)
        session.share.run(session.ingest, monitor, message)

    send(1, 5, 0)
    clock.time += SECOND
    session.share.run(session._tick)
    send(2, 7, 1, 2)
    send(3, 1, 0)
    assert session.core.lateness is not None
    assert session.core.lateness.waiting == 1
    clock.time += SECOND
    async with asyncio.timeout(PATIENCE):
        await session.caught_up()
    assert await sessions.closed_within(session, PATIENCE)
    found, _ = await find(history, session.record, Query(limit=1000))
    assert [(record["seq"], record["row"], record["violation"]) for record in found] == [
        (1, 0, False), (2, 0, False), (2, 1, False), (3, 0, False),
    ]  # fmt: skip
    history.close()
