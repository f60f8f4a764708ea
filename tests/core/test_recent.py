"""The events that explanations point at."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, Step
from oracle_server.core.judging.property_state import PropertyState
from oracle_server.core.judging.recent import LENGTH, Recent
from oracle_server.core.naming import first_name
from oracle_server.core.plan import View
from oracle_server.engines.native import NativeEngine
from tests.core.sessions import A, Feed, open_session, prop


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


def told(recent: Recent, number: int, text: str = "") -> None:
    event = Event(A, "m", number, number, number, None)
    recent.add(number, number, Step(event, {}, frozenset(), number), {"v": text, "n": number})


def numbers(recent: Recent) -> list[int]:
    return [number for number, *_ in recent.snapshot()]


@pytest.mark.parametrize("spare", [0, 10])
def test_of_long_texts_fewer_steps_are_remembered(spare: int) -> None:
    """A thousand texts of a megabyte took a gigabyte, and a snapshot of them seconds, for which all waited."""
    recent = Recent(spare=spare)
    assert numbers(recent) == []
    for number in range(1, 21):
        told(recent, number, "x" * (LENGTH // 4))
    assert numbers(recent) == [16, 17, 18, 19, 20], "four beyond the oldest"
    told(recent, 21, "x" * 2 * LENGTH)
    assert numbers(recent) == [21]
    for number in range(22, 30):
        told(recent, number)
    assert numbers(recent) == [*range(21, 30)]


def test_steps_are_there_again_where_long_ones_behind_them_are_removed() -> None:
    recent, straight = Recent(spare=10), Recent(spare=10)
    for number in range(1, 9):
        told(recent, number, "x" * (LENGTH // 4))
        told(straight, number, "x" * (LENGTH // 4))
    for number in range(9, 14):
        told(recent, number, "x" * LENGTH)
    recent.remove(5)
    assert numbers(recent) == numbers(straight) == [4, 5, 6, 7, 8]


def test_a_snapshot_has_what_failed_and_an_older_one_is_read_without() -> None:
    recent, event = Recent(), Event(A, "m", 7, 10, 10, None)
    recent.add(1, 10, Step(event, {}, frozenset({"v"}), 10), {"w": 1}, frozenset({"v"}))
    (kept,) = recent.snapshot()
    for data, failed in ((kept, ["v"]), (kept[:7], [])):
        again = Recent()
        again.restore([data])
        past = again.past(lambda _: View(0, (), frozenset()))
        assert past.seen is not None
        seen = past.seen(0)
        assert (seen.number, seen.event, seen.signals, [*seen.failed]) == (1, "/a (topic 7 of m)", {"w": 1}, failed)


def test_a_snapshot_has_where_a_property_was_violated_first_and_an_older_one_is_read_without() -> None:
    def fresh() -> PropertyState:
        made = prop("p", "{v < 5}")
        session = open_session([made], attach={"m": [A]}, maker=lambda p: NativeEngine(p.formula, p.time), by="arrival")
        feed = Feed(session)
        for n, v in enumerate((1, 7), start=1):
            feed(A, n, {"v": v})
        return session.judges["arrival"].properties[0]

    saved = fresh().snapshot()
    assert saved is not None
    assert (saved["first_violation"], saved.pop("first_violation_step"), saved.pop("first_violation_at")) == (2, 2, 2)
    older = fresh()
    older.restore(saved)
    assert (older.first_violation, older.first_violation_step, older.first_violation_at) == (2, None, None)
    assert first_name({"first_violation": 2, "first_violation_step": None, "first_violation_at": None}) == "#2"
