"""The reorder buffer by examples: clocks, publishers that lag, equal stamps, deadlines, capacity, closing."""

from __future__ import annotations

from collections.abc import Iterable

import pytest

from oracle_server.core.events import StreamKey
from oracle_server.core.ordering import frontiers
from oracle_server.core.ordering.reorder import Released, ReorderBuffer

A, B, C = (StreamKey(name, "topic") for name in ("/a", "/b", "/c"))
SA, SB, SC = (("m", key) for key in (A, B, C))


def opened(max_delay: int | None, capacity: int = 10_000) -> ReorderBuffer[int]:
    buffer: ReorderBuffer[int] = ReorderBuffer(max_delay, capacity)
    assert buffer.open("m", (A, B, C)) == []
    return buffer


def items(released: Iterable[Released[int]]) -> list[int]:
    return [r.item for r in released]


def test_a_clock_speaks_for_a_silent_stream() -> None:
    buffer = opened(None)
    for number, source in enumerate((SA, SB)):
        assert buffer.push(number, source, "", 5 + number, 10) == []
    assert items(buffer.clock((SC, 5))) == [0]
    assert buffer.clock((SC, 4)) == []
    assert buffer.frontiers[SC] == 5
    assert items(buffer.clock((SC, 6))) == []  # /a may still speak of 5
    assert items(buffer.clock((SA, 6))) == [1]
    assert buffer.clock((("stranger", A), 7)) == []
    assert ("stranger", A) not in buffer.frontiers


def test_a_publisher_that_lags_is_waited_for() -> None:
    buffer = opened(None)
    assert buffer.open("m", (A,)) == []  # and for no others of it
    assert items(buffer.push(0, SA, "fast", 1, 1)) == [0]
    assert items(buffer.push(1, SA, "slow", 1, 1)) == [1]
    assert items(buffer.push(2, SA, "fast", 9, 9)) == []
    assert items(buffer.push(3, SA, "slow", 5, 9)) == [3]
    assert items(buffer.clock((SA, 8))) == []
    assert items(buffer.clock((SA, 9))) == [2]


def test_a_new_publisher_holds_back_a_stream_that_was_ahead() -> None:
    buffer = opened(None)
    buffer.open("m", (A, B))
    assert buffer.clock((SA, 5)) == []
    assert buffer.push(0, SB, "first", 9, 9) == []
    assert items(buffer.push(1, SB, "second", 3, 9)) == [1]
    assert buffer.push(2, SB, "third", 4, 9) == []  # the second may still speak of 3
    assert items(buffer.push(3, SB, "second", 5, 9)) == [2]


def test_of_too_many_publishers_the_one_that_is_furthest_behind_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(frontiers, "MAX_PUBLISHERS", 2)
    buffer = opened(None)
    buffer.open("m", (A,))
    for publisher in ("first", "second"):
        buffer.push(0, SA, publisher, 1, 1)
    assert items(buffer.push(1, SA, "first", 5, 9)) == []
    assert items(buffer.push(2, SA, "third", 4, 9)) == [2]  # the second may be gone
    assert buffer.publishers(SA) == (2, 1)
    assert items(buffer.push(3, SA, "second", 6, 9)) == [1]  # and is a new one: the third is forgotten
    assert buffer.frontiers[SA] == 5


def test_equal_stamps_keep_the_order_of_arrival() -> None:
    buffer = opened(10)
    released = [r for n in range(30) for r in buffer.push(n, (SA, SB, SC)[n % 3], "", 7, n // 10)]
    assert items(released + buffer.flush()) == list(range(30))


def test_waits_max_delay_and_no_longer() -> None:
    buffer = opened(10)
    buffer.push(0, SA, "", 50, 100)
    buffer.push(1, SA, "", 60, 101)
    buffer.push(2, SB, "", 40, 105)
    assert buffer.next_deadline == 110
    assert buffer.advance(109) == []
    assert buffer.advance(110) == [
        Released(2, "max_delay", waited=(SC,)),
        Released(0, "max_delay", waited=(SB, SC)),
    ]  # the older one goes first, though it came later
    assert buffer.push(3, SC, "", 49, 110) == [Released(3, "max_delay", late=True)]
    assert buffer.push(4, SC, "", 50, 110) == []
    assert buffer.advance(111) == [
        Released(4, "max_delay", waited=(SB,)),
        Released(1, "max_delay", waited=(SB, SC)),
    ]
    assert buffer.next_deadline is None


def test_the_oldest_leaves_for_want_of_room() -> None:
    buffer = opened(None, capacity=2)
    assert [buffer.push(n, SA, "", stamp, n) for n, stamp in enumerate((3, 5, 5))][:2] == [[], []]
    assert len(buffer) == 2
    assert buffer.push(3, SB, "", 4, 4) == [Released(3, "capacity", waited=(SC,))]
    assert buffer.push(4, SB, "", 2, 5) == [Released(4, "max_delay", late=True)]


def test_closing_lets_the_others_go_on() -> None:
    buffer = opened(None)
    buffer.open("n", (A,))
    assert [buffer.push(n, s, "", 9, 9) for n, s in enumerate((SA, SB, SC))] == [[], [], []]
    assert buffer.awaited == ("n", A)
    assert opened(None).awaited is None, "nothing is held that could wait"
    assert items(buffer.close("n")) == [0, 1, 2]
    assert buffer.push(3, SA, "", 12, 12) == []
    assert items(buffer.open("m", (A,))) == [3]
    assert buffer.push(4, SB, "", 13, 13) == []
    assert items(buffer.close("m")) == [4]
    assert buffer.flush() == []


def test_bursts_of_thousands_of_equal_stamps_keep_the_order_of_arrival_and_lose_nothing() -> None:
    buffer = opened(None)
    released = []
    for burst in range(3):
        for n in range(3_000):
            released += buffer.push(3_000 * burst + n, (SA, SB, SC)[n % 3], str(n % 7), burst, burst)
    assert len(buffer) + len(released) == 9_000
    released += buffer.flush()
    assert items(released) == list(range(9_000))
    assert not any(r.late or r.forced for r in released)
