"""How an open session stands where only its rows are read: as where it is judged."""

from __future__ import annotations

import asyncio
import random
from typing import Literal

import msgspec
import pytest

from oracle_server.core.verdicts import Decision, Outcome
from oracle_server.history.port import History
from oracle_server.sessions.committed import committed
from oracle_server.sessions.elsewhere import Others
from oracle_server.sessions.unrestored import bare
from tests.core.revising import case
from tests.history.backends import Make
from tests.history.making import opened, step
from tests.history.test_revised_sessions import Kept, write

NAME = "s@robot"
"""A session that no server has for itself."""


def judged(seed: int, time: Literal["steps", "seconds"]) -> Kept:
    """A session some of whose events are late, skipped, or taken back."""
    run = Kept(case(random.Random(seed), time), suspends=random.Random(seed) if seed % 3 == 0 else None)
    run.judge(random.Random(seed))
    return run


async def told(history: History, run: Kept, seed: int) -> tuple[list[str], list[str]]:
    """The outcomes of its properties, as another server tells them, and as a recording's are that broke off."""
    history.start(asyncio.get_running_loop())
    await write(history, run, random.Random(seed), opened(name=NAME)._replace(text="late: revise"))
    other = await Others(history).state(NAME)
    (found,) = await history.open_elsewhere(NAME)
    alone = await committed(history, found.record, bare(found.record))
    await asyncio.to_thread(history.close)
    assert other is not None
    return [p["outcome"] for p in other["properties"]], [p["outcome"] for p in alone["properties"]]


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize(("backend", "cases"), [("sqlite", 120), ("postgres", 25)])
async def test_a_session_that_revises_stands_by_its_rows_as_where_it_is_judged(
    backend: str, cases: int, time: Literal["steps", "seconds"], make: Make
) -> None:
    revised = 0
    for seed in range(cases):
        run = judged(seed, time)
        wanted = [state.outcome.value for state in run.session.judges["publication"].told.properties]
        assert await told(make(backend), run, seed) == (wanted, wanted), f"case {seed}"
        revised += len(run.book.revisions) > 0
    assert revised > cases // 10


@pytest.mark.parametrize("backend", ["sqlite", "postgres"])
async def test_what_was_skipped_or_taken_back_tells_of_no_property(backend: str, make: Make) -> None:
    history = make(backend)
    history.start(asyncio.get_running_loop())
    history.open_session(opened(name=NAME))
    false = (Outcome.CURRENTLY_FALSE, Outcome.CURRENTLY_FALSE)
    tried = step(3, outcomes=false, decision=Decision("deny", ("p",)))
    taken_back = msgspec.structs.replace(tried, number=0)
    for row in (step(1), step(2, outcomes=false, number=None), taken_back):
        history.append(1, [row], lambda: None)
    await history.flush()
    (other,) = await history.open_elsewhere(NAME)
    await asyncio.to_thread(history.close)
    assert [p.outcome for p in other.properties] == [Outcome.CURRENTLY_TRUE] * 2


@pytest.mark.parametrize("backend", ["sqlite", "postgres"])
async def test_which_properties_are_degraded_is_told_and_which_for_now_alone(backend: str, make: Make) -> None:
    history = make(backend)
    history.start(asyncio.get_running_loop())
    history.open_session(opened(name=NAME))
    history.append(1, [msgspec.structs.replace(step(1), degraded=(True, True), bypassed=(1,))], lambda: None)
    await history.flush()
    (other,) = await history.open_elsewhere(NAME)
    told = await Others(history).state(NAME)
    await asyncio.to_thread(history.close)
    assert told is not None
    first, second = told["properties"]
    assert [(p.degraded, p.bypassed) for p in other.properties] == [(True, False), (False, True)]
    assert (first["degraded"], first["caveats"], second["degraded"], len(second["caveats"])) == (True, [], False, 1)


async def test_all_that_are_open_are_told_of(make: Make) -> None:
    history = make("sqlite")
    history.start(asyncio.get_running_loop())
    for number in range(1, 1_102):
        history.open_session(opened(number, f"s{number}@robot"))
    await history.flush()
    found = await history.open_elsewhere(origin="robot")
    await asyncio.to_thread(history.close)
    assert [other.record.number for other in found] == [*range(1_101, 0, -1)], "the oldest, too"
