"""Machines told apart by several signals: what is said of one, what there is no room for, and restarts."""

from __future__ import annotations

import json
from typing import Any

import pytest

from oracle_server.core.derived import parametric
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

# Fail-safe iterators, as JavaMOP has them: a collection is not changed while one of its iterators is used.
SPEC = """
id: iterators
ordering: {by: arrival}
streams:
  - {topic: /use, signals: {op: msg.op, c: msg.c, i: msg.i}}
define:
  create: '{op: create}'
  update: '{op: update}'
  use: '{op: use}'
derive:
  used: {by: [c, i], start: fresh, states: {fresh: {create: live}, live: {use: live, update: old}, old: {update: old}}}
properties:
  - {id: safe, machine: used}
"""
USE = StreamKey("/use", "topic")
SECOND = 10**9


class Told:
    """A session that is told of what is done with collections and iterators, a second after the other."""

    def __init__(self, text: str = SPEC) -> None:
        self.ready = plan(parse_spec(text, "spec.yaml").spec)
        self.session = Session(self.ready, [make_engines(self.ready)[0]], begun=0)
        self.number = 0

    def tell(self, op: str, **which: Any) -> Judged:
        self.number += 1
        at = self.number * SECOND
        (judged,) = self.session.ingest(Event(USE, "m", self.number, at, at, {"op": op, **which}))
        return judged

    def outcome(self, op: str, **which: Any) -> str:
        return str(self.tell(op, **which).verdicts[0].outcome.current.value)


def test_an_event_with_one_of_the_keys_is_of_all_that_agree_and_violates_where_it_is_sent() -> None:
    told = Told()
    for i in (1, 2):
        assert told.outcome("create", c="a", i=i) == "currently_true"
    assert told.outcome("create", c="b", i=3) == "currently_true"
    assert told.outcome("update", c="a") == "currently_true"
    assert told.outcome("use", i=3) == "currently_true", "its collection was not changed"
    wrong = told.tell("use", i=2)
    why = wrong.verdicts[0].explanation
    assert wrong.verdicts[0].outcome.current.value == "currently_false"
    assert why is not None
    assert why.text is not None
    assert 'used "error" for c "a", i 2: old since step 4 (update); use at step 6; allowed: nothing' in why.text
    assert told.outcome("use", i=9) == "currently_true", "there is no such iterator"


def test_an_event_of_a_key_that_is_not_known_may_be_of_any() -> None:
    told = Told()
    told.tell("create", c="a", i=1)
    assert told.outcome("update", c={}) == "unknown"
    assert told.outcome("use", i=1) == "unknown"


def test_machines_that_have_no_room_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parametric, "MAX_PARAMETRIC", 1)
    told = Told()
    assert told.outcome("create", c="a", i=1) == "currently_true"
    assert told.outcome("create", c="b", i=2) == "unknown"
    assert told.outcome("use", i=1) == "unknown", "it may be of another collection, too"
    assert told.outcome("use", c="a", i=1) == "currently_true"


def test_true_and_one_are_told_apart_after_a_restart() -> None:
    told = Told()
    for i in (1, True):
        told.tell("create", c="a", i=i)
    told.tell("update", c="a", i=True)
    again = Told()
    again.session.restore(json.loads(json.dumps(told.session.snapshot())), told.number + 1)
    again.number = told.number
    assert again.outcome("use", i=1) == "currently_true"
    assert again.outcome("use", i=True) == "currently_false"
