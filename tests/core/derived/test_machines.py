"""Machines: memory and room, their explanations, and what of many keys and of failures can't be told by few cases."""

from __future__ import annotations

import pytest

from oracle_server.core.derived import machine
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """
id: nodes
ordering: {by: arrival}
streams:
  - {topic: /transition, signals: {node: msg.node, transition: msg.transition}}
define:
  configure: '{transition: configure}'
  activate: '{transition: activate}'
  deactivate: '{transition: deactivate}'
  cleanup: '{transition: cleanup}'
derive:
  nav:
    by: node
    forget: 1h
    start: unconfigured
    states:
      unconfigured: {configure: inactive}
      inactive: {activate: active, cleanup: unconfigured}
      active: {deactivate: inactive}
properties:
  - {id: nav_ok, machine: nav}
"""
WITHIN = SPEC.replace("active: {deactivate: inactive}", "active: {deactivate: inactive, within: 30s}")
TRANSITION = StreamKey("/transition", "topic")
SECOND = 10**9


class Told:
    """A session that is told of transitions, each a second after the other."""

    def __init__(self, text: str) -> None:
        self.ready = plan(parse_spec(text, "spec.yaml").spec)
        self.session = Session(self.ready, [make_engines(self.ready)[0]], begun=0)
        self.number = 0

    def tell(self, node: object, transition: str) -> list[Judged]:
        self.number += 1
        at = self.number * SECOND
        data = {"node": node, "transition": transition}
        return list(self.session.ingest(Event(TRANSITION, "m", self.number, at, at, data)))

    @property
    def violations(self) -> int:
        return self.session.judges["arrival"].told.properties[0].violations

    def outcomes(self, *told: tuple[object, str]) -> list[str]:
        return [j.verdicts[0].outcome.current.value for each in told for j in self.tell(*each)]


def test_an_event_that_a_state_has_not_is_explained() -> None:
    told = Told(SPEC)
    told.outcomes(("/amcl", "configure"), ("/map", "configure"), ("/amcl", "activate"), ("/map", "cleanup"))
    (judged,) = told.tell("/amcl", "cleanup")
    why = judged.verdicts[0].explanation
    assert why is not None
    assert why.text is not None
    assert (
        'nav "error" for node "/amcl": active since step 3 (activate); cleanup at step 5; allowed: deactivate'
    ) in why.text
    assert why.text.startswith('"nav": ')


def test_machines_of_other_keys_stand_as_they_stood() -> None:
    told = Told(SPEC)
    assert told.outcomes(("/a", "configure"), ("/b", "activate"), ("/a", "activate"), ("/b", "configure")) == [
        "currently_true", "currently_false", "currently_true", "currently_false",
    ]  # fmt: skip


def test_an_event_of_a_key_that_is_not_known_may_be_of_any() -> None:
    told = Told(SPEC)
    assert told.outcomes(("/a", "configure"), ({}, "activate"), ("/a", "activate"), ("/b", "configure")) == [
        "currently_true", "unknown", "unknown", "unknown",
    ]  # fmt: skip


def test_machines_that_have_no_room_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "MAX_MACHINES", 2)
    told = Told(SPEC)
    assert told.outcomes(("/a", "configure"), ("/b", "configure"), ("/c", "configure"), ("/a", "activate")) == [
        "currently_true", "currently_true", "unknown", "currently_true",
    ]  # fmt: skip


def test_an_error_is_one_violation_as_long_as_it_lasts() -> None:
    for text in (SPEC, WITHIN):
        told = Told(text)
        wrong = [("/a", "activate"), *[("/a", "configure")] * 3]
        assert told.outcomes(*wrong) == ["currently_false"] * 4
        assert told.violations == 1, text
        assert told.outcomes(({}, "configure"), ("/b", "configure")) == ["unknown"] * 2
        assert told.violations == 1, text


def test_an_error_behind_a_state_that_was_not_left_is_a_violation_of_its_own() -> None:
    told = Told(WITHIN)
    told.outcomes(("/a", "configure"), ("/a", "activate"))
    assert len([*told.session.advance(33 * SECOND)]) == told.violations == 1
    told.number = 40
    assert told.outcomes(("/a", "activate"), ("/a", "activate"), ("/a", "activate")) == ["currently_false"] * 3
    assert told.violations == 2


def test_a_state_that_is_not_left_in_time_counts_while_another_machine_is_in_an_error() -> None:
    told = Told(WITHIN)
    told.outcomes(("/a", "configure"), ("/a", "activate"), ("/b", "activate"))
    late = [*told.session.advance(33 * SECOND)]
    assert [len(j.verdicts[0].explanation.about) for j in late if j.verdicts[0].explanation] == [1]
    told.number = 40
    assert told.outcomes(("/b", "activate")) == ["currently_false"]
    assert told.violations == 2


def test_a_state_that_is_not_left_in_time_is_a_violation() -> None:
    told = Told(WITHIN)
    told.outcomes(
        ("/a", "configure"), ("/a", "activate"), ("/b", "configure"), ("/b", "activate"), ("/b", "deactivate")
    )
    late = [j for j in told.session.advance(33 * SECOND) if j.verdicts[0].outcome.current.value == "currently_false"]
    assert [j.step.stamp for j in late] == [32 * SECOND + 1]
    assert not [j for j in told.session.advance(99 * SECOND) if j.verdicts[0].outcome.current.value != "currently_true"]
    assert [o.outcome.current.value for j in told.tell("/a", "cleanup") for o in j.verdicts] == ["currently_false"]
