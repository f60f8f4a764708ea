"""Times since a robot's start: their order is kept whatever the delays, and they become times since 1970."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core import boot
from oracle_server.core.boot import BootClock

MS = 10**6
SKEW = 1000 * MS
START = 1_700_000_000 * 10**9
many = settings(max_examples=300, deadline=None, database=None)


@st.composite
def arrivals(draw: st.DrawFn, longest: int) -> list[tuple[str, int, int]]:
    """Messages of three publishers as they arrive: publisher, time since the start, arrival (ns); one each MS at most.

    Each publisher's own arrive in order, delayed by at most `longest`.
    """
    times = draw(st.lists(st.integers(1, 60_000), min_size=1, max_size=40, unique=True))
    sent = [(draw(st.sampled_from("abc")), time * MS) for time in sorted(times)]
    came: dict[str, int] = {}
    found = []
    for source, since in sent:
        at = max(came.get(source, 0), START + since + draw(st.integers(0, longest)))
        came[source] = at
        found.append((source, since, at))
    return sorted(found, key=lambda message: message[2])


@many
@given(arrivals(longest=60_000 * MS))
def test_no_later_message_is_told_to_be_earlier_whatever_the_delays(messages: list[tuple[str, int, int]]) -> None:
    clock = BootClock(SKEW)
    placed = [(since, clock.place(source, since, arrived), arrived) for source, since, arrived in messages]
    in_order = [time for _, time, _ in sorted(placed)]
    assert in_order == sorted(in_order)
    assert all(time <= arrived + SKEW for _, time, arrived in placed)


@many
@given(arrivals(longest=SKEW))
def test_with_usual_delays_the_error_is_the_first_ones_delay(messages: list[tuple[str, int, int]]) -> None:
    clock = BootClock(SKEW)
    _, first, arrived = messages[0]
    for source, since, at in messages:
        assert clock.place(source, since, at) == since + (arrived - first)


def test_a_restart_of_the_robot_fixes_the_clock_anew() -> None:
    clock = BootClock(SKEW)
    assert clock.place("a", 600_000 * MS, START) == START
    assert clock.place("b", 600_010 * MS, START + 10 * MS) == START + 10 * MS
    assert clock.place("a", 2_000 * MS, START + 60_000 * MS) == START + 60_000 * MS
    assert clock.place("b", 2_005 * MS, START + 60_500 * MS) == START + 60_005 * MS


def test_one_publishers_old_message_is_no_restart() -> None:
    clock = BootClock(SKEW)
    clock.place("a", 600_000 * MS, START)
    assert clock.place("kept", 2_000 * MS, START + MS) == START - 598_000 * MS
    assert clock.place("a", 600_010 * MS, START + 10 * MS) == START + 10 * MS


def test_a_first_message_that_came_late_does_not_put_all_others_ahead() -> None:
    clock = BootClock(SKEW)
    clock.place("kept", 2_000 * MS, START)  # published long ago, and kept for who comes later
    assert clock.place("a", 600_000 * MS, START + MS) == START + MS
    assert clock.place("a", 600_100 * MS, START + 101 * MS) == START + 101 * MS


def test_publishers_that_are_always_new_take_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(boot, "_MOST_PUBLISHERS", 2)
    clock = BootClock(SKEW)
    placed = [clock.place(f"p{i}", i * MS, START + i * MS) for i in range(1, 100)]
    assert placed == [START + i * MS for i in range(1, 100)]
    assert clock.place("p99", MS, START + 200 * MS) == START + MS, "no restart: it is not far enough back"
    assert len(clock._newest) == 2


@pytest.mark.parametrize("known", [2**63 - 1, 2**62, 10**18])
def test_no_time_is_later_than_a_time_can_be(known: int) -> None:
    clock = BootClock(10**9)
    latest = 2**63 - 1
    placed = [clock.place("a", since, known) for since in (1, 2, 10**9, 2**62, latest)]
    assert placed == sorted(placed)
    assert all(1 <= at <= latest for at in placed)
