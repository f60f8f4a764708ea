"""The events that explanations point at."""

from __future__ import annotations

from oracle_server.core.events import Event, Step
from oracle_server.core.recent import Recent
from tests.core.sessions import A


def test_of_several_steps_of_one_time_none_is_taken_for_the_one() -> None:
    recent = Recent()
    for number, time in ((1, 10), (2, 10), (3, 20)):
        event = Event(A, "m", number, time, time, None)
        recent.add(number, time, Step(event, {}, frozenset(), time), {})
    assert recent.recall(10, None, timed=True) is None
    for at, step, seq in ((10, 1, 1), (10, 2, 2), (20, None, 3)):
        found = recent.recall(at, step, timed=True)
        assert found
        assert found["seq"] == seq
    assert recent.recall(4, None, timed=False) is None
