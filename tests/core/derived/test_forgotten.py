"""Machines are let go of now and then: what is said is as if each were, as soon as it is forgotten."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as some

from oracle_server.core.derived import machine, parametric
from oracle_server.core.derived.machine import Machines
from oracle_server.core.derived.queue import Key, Queue
from oracle_server.core.derived.state import Derived
from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import Plan, plan
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: doors
ordering: {by: arrival}
streams:
  - {topic: /door, signals: {a: msg.a, b: msg.b, did: msg.did}}
define: {open: '{did: open}', close: '{did: close}'}
derive:
  door: {by: BY, forget: 4ns, start: shut, states: {shut: {open: wide}, wide: {close: shut}}}
properties:
  - {id: right, machine: door}
"""
DOOR = StreamKey("/door", "topic")
ONE = plan(parse_spec(SPEC.replace("BY", "a"), "spec.yaml").spec)
SEVERAL = plan(parse_spec(SPEC.replace("BY", "[a, b]"), "spec.yaml").spec)
FEW = 3

Told = tuple[int, dict[str, Scalar], bool]
"""How many ns after the step before, with which signals, and whether it is taken back."""
told = some.tuples(
    some.integers(0, 3),
    some.fixed_dictionaries(
        {"did": some.sampled_from(["open", "close"])},
        optional={"a": some.integers(0, 4), "b": some.integers(0, 1)},
    ),
    some.booleans(),
)


def said(ready: Plan, steps: list[Told], *, at_once: bool = False, kept: bool = False) -> list[Any]:
    """What the signal is at each step, and whether it has failed.

    `at_once`: machines are let go of as soon as they are forgotten. `kept`: each step is taken over by another one.
    """
    derived, parts, found, now = Derived(ready.derived), ready.streams[DOOR].derives, [], 0
    derived.begin(0)
    for number, (later, signals, back) in enumerate(steps, start=1):
        if back:
            derived.journal.mark()
        if at_once:
            (machines,) = derived._series
            assert isinstance(machines, Machines)
            machines._let_go(now + later - 4)
        own = dict(signals)
        event = Event(DOOR, "m", number, now + later, now + later, {})
        step = Step(event, own, frozenset(), now + later)
        failed = derived.step(parts, step, own, frozenset(), now + later, number)
        found.append((own.get("door"), "door" in failed))
        if back:
            derived.journal.back()
        else:
            now += later
        if kept:
            data, derived = json.loads(json.dumps(derived.snapshot())), Derived(ready.derived)
            derived.restore(data)
    return found


@pytest.mark.parametrize("ready", [ONE, SEVERAL], ids=["one", "several"])
@given(steps=some.lists(told, max_size=30))
def test_what_is_forgotten_makes_room_at_once(ready: Plan, steps: list[Told]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "MAX_MACHINES", FEW)
        patch.setattr(parametric, "MAX_PARAMETRIC", FEW)
        lazily = said(ready, steps)
        assert lazily == said(ready, steps, at_once=True)
        assert lazily == said(ready, steps, kept=True)


def test_machines_that_make_room_one_by_one_are_not_all_looked_at_for_each(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "MAX_MACHINES", 4)
    filled: list[int] = []
    fill = Queue.fill

    def count(queue: Queue, pairs: list[tuple[int, Key]]) -> None:
        filled.append(len(pairs))
        fill(queue, pairs)

    monkeypatch.setattr(Queue, "fill", count)
    found = said(ONE, [(1, {"did": "open", "a": n}, False) for n in range(1000)])
    assert found == [("wide", False)] * 1000
    assert sum(filled) <= 1000


def test_no_more_are_kept_than_twice_what_is_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "_FEW", FEW)
    derived, parts = Derived(ONE.derived), ONE.streams[DOOR].derives
    derived.begin(0)
    for n in range(1000):
        own: dict[str, Scalar] = {"did": "open", "a": n}
        derived.step(parts, Step(Event(DOOR, "m", n + 1, n, n, {}), dict(own), frozenset(), n), own, frozenset(), n, n)
    (machines,) = derived._series
    assert isinstance(machines, Machines)
    assert 4 <= len(machines._standings) <= 2 * 4 + 1
