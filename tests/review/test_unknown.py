"""Why a verdict is no judgement, told truly: most of all of deadlines, which judge few properties."""

from __future__ import annotations

import asyncio
from pathlib import Path

import msgspec
import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from oracle_server.review.again import NoExplanationError
from oracle_server.review.explanation import explained
from oracle_server.wire.incoming import EventMessage
from tests.processes import PATIENCE
from tests.sessions.making import Kept, Standing, attach, registry

SPEC = """
id: spec
ordering: {max_delay: 20ms, late: LATE}
streams:
  - topic: /a
    signals: {v: '1 / msg.v', w: '1 / msg.w'}
  - topic: /h
    hold: [h]
    signals: {h: '1 / msg.h'}
properties:
  - id: here
    time: seconds
    formula: 'once[:50ms]{topic: "/b"}'
  - id: small
    formula: 'not {v > 5}'
  - id: held
    formula: '{topic: "/a"} -> {h > 0}'
  - id: long
    time: seconds
    formula: 'once[:1h]{topic: "/b"}'
"""
WIDTH = 4


async def rows_of(folder: Path, late: str, *sent: EventMessage) -> tuple[MemoryHistory, list[StoredStep]]:
    """What a session kept of these events, up to the deadline at which the grace of `here` is over."""
    history, clock = MemoryHistory(), Standing()
    text = SPEC.replace("LATE", late).replace("streams:", "streams:\n  - topic: /b", 1)
    sessions = registry(history, folder / "specs", text, clock=clock)
    live, monitor = await sessions.attach(attach("s", "spec"), Kept())
    for message in sent:
        live.ingest(monitor, message)
    clock.time += 10**9  # not before: a machine that stands still would have the deadline come first
    async with asyncio.timeout(PATIENCE):
        while True:
            rows = [row async for page in history.steps(1, 0) for row in page]
            if any(row.is_tick for row in rows):
                return history, rows
            await asyncio.sleep(0.01)


async def why_not(history: MemoryHistory, row: StoredStep, index: int) -> str:
    n = (row.position - 1) * WIDTH + index + 1
    with pytest.raises(NoExplanationError) as error:
        await explained(history, 1, n)
    return str(error.value).removeprefix(f"verdict {n} is no judgement: ")


def message(seq: int, stream: str, **data: int) -> EventMessage:
    return EventMessage(seq=seq, stream=stream, data=data)


@pytest.mark.parametrize("late", ["judge", "revise"])
async def test_a_deadline_before_the_first_event_judges_what_never_came_and_nothing_else(
    tmp_path: Path, late: str
) -> None:
    history, (tick,) = await rows_of(tmp_path, late)
    assert [*tick.outcomes] == ["currently_false", "unknown", "unknown", "unknown"]
    assert await why_not(history, tick, 1) == "no event had been judged when it was told"
    assert await why_not(history, tick, 3) == (
        "the session began less than 3600 s before, so that nothing is missing yet"
    )


@pytest.mark.parametrize("late", ["judge", "revise"])
async def test_at_a_deadline_of_others_it_is_as_unknown_as_it_was_at_the_last_step(tmp_path: Path, late: str) -> None:
    history, (step, tick) = await rows_of(tmp_path, late, message(1, "/a", v=0, w=1))
    assert step.outcomes[1] == tick.outcomes[1] == "unknown"
    assert await why_not(history, step, 1) == "computing failed for v"
    assert await why_not(history, tick, 1) == "it was unknown at step 1 already: computing failed for v"


async def test_which_step_stands_before_a_deadline_is_not_guessed_where_one_came_late(tmp_path: Path) -> None:
    history, (step, _) = await rows_of(tmp_path, "revise", message(1, "/a", v=0, w=1))
    history._of(1).steps[0] = msgspec.structs.replace(step, place=1)
    (_, tick) = [row async for page in history.steps(1, 0) for row in page]
    assert await why_not(history, tick, 1) == "it was unknown before already, or the engine failed"


@pytest.mark.parametrize("late", ["judge", "revise"])
async def test_only_signals_that_the_property_reads_are_named(tmp_path: Path, late: str) -> None:
    history, (step, _) = await rows_of(tmp_path, late, message(1, "/a", v=0, w=0))
    assert await why_not(history, step, 1) == "computing failed for v"


@pytest.mark.parametrize("late", ["judge", "revise"])
async def test_a_held_signal_may_have_failed_before(tmp_path: Path, late: str) -> None:
    history, (_, step, tick) = await rows_of(tmp_path, late, message(1, "/h", h=0), message(2, "/a", v=1, w=0))
    assert await why_not(history, step, 2) == "what is held of h had failed, or the engine did"
    assert await why_not(history, tick, 2) == "computing failed for h"
