"""Obligations beside properties that read derived signals: neither's ticks change what the other is told."""

from __future__ import annotations

import random
from typing import Any

import pytest

from oracle_server.core.events import ENDED, Event, Order
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import SECOND
from oracle_server.core.verdicts import Judged, record
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from tests.core.sessions import A

OWING = """id: x
streams:
  - {{topic: /a, signals: {{goal: msg.goal, done: msg.done, v: msg.v}}}}
ordering: {{max_delay: 0s, by: {by}}}
properties:
  - {{id: p, formula: 'forall[g]. {{goal: *g}} -> {goal}', time: seconds, at_end: violated}}
"""
DERIVED = """
  - {id: q, formula: '{n < 2}', time: seconds}
  - {id: r, formula: '{m < 2}', time: seconds}
  - {id: s, formula: 'not {w > 2}', time: seconds}
derive:
  n: {count: '{v}', over: 3s}
  m: {count: '{v}', over: 2s, by: goal}
  w: {age: '{v}'}
"""
GOALS = (
    "eventually[:2s] {done: *g}",
    "always[1s:3s] not {done: *g}",
    "next {done: *g}",
    "{v} until[:3s] {done: *g}",
)


def opened(text: str) -> Session:
    ready = plan(parse_spec(text, "x").spec)
    session = Session(ready, make_engines(ready))
    assert session.attach("m", [A], 0) == []
    return session


def events(rng: random.Random) -> list[Event]:
    found, time = [], SECOND
    for n in range(1, rng.randint(4, 15)):
        time += rng.choice((0, SECOND // 2, SECOND, 2 * SECOND, 4 * SECOND))
        data: dict[str, Any] = {rng.choice(("goal", "done")): rng.choice("ab")}
        if rng.random() < 0.5:
            data = {"v": True} if rng.random() < 0.5 else {"v": True, "goal": rng.choice("ab")}
        found.append(Event(A, "m", n, time, time, data))
    return found


def judge(session: Session, given: list[Event]) -> list[Judged]:
    judged = [each for event in given for each in session.ingest(event)]
    judged += session.finish(given[-1].arrived + 9 * SECOND)
    return judged + session.end(session.now)


def unanswered(judged: list[Judged]) -> list[tuple[object, ...]]:
    """What is told of obligations, and when; the end is as late as the last deadline of any property."""
    found: list[tuple[object, ...]] = []
    for each in judged:
        told = record(each, each.verdicts[0])
        when = None if each.step.event.source == ENDED else told["stamp"]
        if told["about_count"]:
            about = [(one.get("step"), one["values"]) for one in told["about"]]
            found.append((told["kind"], when, told["outcome"], about, told["pending"]))
    return found


@pytest.mark.parametrize("by", ["publication", "arrival"])
@pytest.mark.parametrize("goal", GOALS)
def test_derived_signals_of_other_properties_change_no_obligation(by: Order, goal: str) -> None:
    failed = 0
    for seed in range(40):
        given, alone = events(random.Random(seed)), OWING.format(by=by, goal=goal)
        judged = judge(opened(alone + DERIVED), given)
        assert unanswered(judged) == unanswered(judge(opened(alone), given)), seed
        failed += len(unanswered(judged))
        session = opened(alone + DERIVED)
        again = [session.rejudge(by, each.step, each.judged) for each in judged]
        told = [[record(each, v) for v in each.verdicts] for each in judged]
        assert [[record(each, v) for v in each.verdicts] for each in again if each is not None] == told, seed
    assert failed
