"""What runs out at one time may be decided piece by piece, whatever comes in between: all is told as if at once."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest

from oracle_server.core.events import Event
from oracle_server.core.judging.judge import Judge
from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged, record
from tests.core.sessions import A
from tests.core.test_obligations_derived import DERIVED, GOALS, OWING, opened

LATCHED = """\
  - {id: l, formula: 'forall[g]. {goal: *g} -> eventually[:2s] {done: *g, v: true}', time: seconds, latch: true}
"""
_OF_TURNS = {"arrived", "judged", "n"}
"""What a record says of when it was judged, and in two orders of what was judged before it in the other one."""


def spec(rng: random.Random) -> str:
    text = OWING.format(by=rng.choice(("arrival", "publication", "both")), goal=rng.choice(GOALS))
    text += rng.choice(("", LATCHED)) + rng.choice(("", DERIVED.lstrip("\n")))
    return text.replace("max_delay: 0s", rng.choice(("max_delay: 0s", "max_delay: 1s", "max_delay: 1s, late: skip")))


def events(rng: random.Random) -> list[Event]:
    """Many of one time, and some late."""
    found, time = [], SECOND
    for n in range(1, rng.randint(6, 25)):
        time += rng.choice((0, 0, 0, SECOND // 2, SECOND, 2 * SECOND, 4 * SECOND))
        data: dict[str, Any] = {rng.choice(("goal", "goal", "done")): rng.choice("abcde")}
        if rng.random() < 0.5:
            data["v"] = True
        found.append(Event(A, "m", n, time - rng.choice((0, 0, 0, SECOND)), time, data))
    return found


def course(seed: int, enough: Callable[[], bool]) -> tuple[list[Any], list[Any], int]:
    """What is told, how the properties stand at the end, and how often something came between two pieces."""
    rng = random.Random(f"divided {seed}")
    session, judged, between = opened(spec(rng)), list[Judged](), 0
    for event in events(rng):
        before, looks = event.arrived - rng.choice((0, 1, SECOND)), rng.randint(0, 3)
        judged += divided(session.judges.values(), enough, session.advance, before)
        for _ in range(looks if session.is_behind else 0):
            judged += divided(session.judges.values(), enough, session.advance, before)
        between += any(judge.is_deciding for judge in session.judges.values())
        judged += session.ingest(event)
    end = session.now + rng.choice((0, 3 * SECOND, 20 * SECOND))
    judged += divided(session.judges.values(), enough, session.advance, end)
    judged += session.finish(end) + session.end(end)
    told = [(row.order, [_told(row, i) for i in range(len(row.verdicts))]) for row in judged]
    states = [state for judge in session.judges.values() for state in judge.properties]
    return (
        sorted(told, key=lambda row: row[0]),
        [(s.outcome, s.violations, s.pending, s.failures, s.first_violation_at) for s in states],
        between,
    )


def divided(judges: Any, enough: Callable[[], bool], advance: Callable[[int], list[Judged]], now: int) -> list[Judged]:
    """What is judged of a look at the time of which each turn decides until `enough`."""
    decide = Judge.decide
    for judge in judges:
        judge.decide = lambda time, _, judge=judge: decide(judge, time, enough)
    try:
        return advance(now)
    finally:
        for judge in judges:
            del judge.decide


def _told(row: Judged, place: int) -> dict[str, Any]:
    return {name: value for name, value in record(row, row.verdicts[place]).items() if name not in _OF_TURNS}


@pytest.mark.parametrize("part", range(2))
def test_in_pieces_all_is_told_as_at_once_whatever_comes_between_them(part: int) -> None:
    between = 0
    for seed in range(part * 100, part * 100 + 100):
        told, states, _ = course(seed, lambda: False)
        again, then, count = course(seed, lambda: True)
        assert (again, then) == (told, states), seed
        between += count
    assert between > 50
