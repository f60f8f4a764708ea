"""When clocks may speak for others: not while a busy adapter hears nothing, else always."""

from __future__ import annotations

from typing import List

from oracle_adapter.attention import BUSY, LONGEST_STALL, SETTLE, SILENCE, Attention

TICK = 0.01


class Adapter:
    """One that looks a hundred times a second."""

    def __init__(self) -> None:
        self.attention = Attention()
        self.ticks = self.total = 0

    def hears(self, seconds: float, every: int = 0, burst: int = 0) -> List[bool]:
        """What it is told while it hears a message every so many ticks, after a burst."""
        told = []
        self.total += burst
        for _ in range(round(seconds / TICK)):
            self.ticks += 1
            self.total += bool(every) and self.ticks % every == 0
            told.append(self.attention.is_paid(self.ticks * TICK, self.total))
        return told


def test_a_busy_adapter_speaks_all_the_time() -> None:
    assert all(Adapter().hears(10, every=2))


def test_a_quiet_adapter_speaks_through_its_silences() -> None:
    adapter = Adapter()
    assert all(adapter.hears(10, every=20))
    assert all(adapter.hears(10))


def test_one_that_never_heard_anything_speaks() -> None:
    assert all(Adapter().hears(10))


def test_a_busy_adapter_that_hears_nothing_stops_until_what_was_held_up_has_come() -> None:
    adapter = Adapter()
    adapter.hears(3, every=2)
    silent = adapter.hears(0.3)
    assert all(silent[: round(SILENCE / TICK) - 1])
    assert not any(silent[round(SILENCE / TICK) + 2 :])
    after = adapter.hears(1, every=2, burst=20)
    assert not any(after[: round(SETTLE / TICK) - 1])
    assert all(after[round(SETTLE / TICK) + 2 :])


def test_silence_that_lasts_is_silence() -> None:
    adapter = Adapter()
    adapter.hears(3, every=2)
    silent = adapter.hears(LONGEST_STALL + 1)
    assert not any(silent[10 : round(LONGEST_STALL / TICK) - 2])
    assert all(silent[round(LONGEST_STALL / TICK) + 2 :])
    assert all(adapter.hears(1, every=2)), "what comes after it was not held up"


def test_how_busy_it_is_counts_by_the_second() -> None:
    adapter = Adapter()
    for _ in range(5):
        assert all(adapter.hears(2, burst=BUSY - 1)), "a burst now and then"


def test_a_count_that_begins_anew_is_no_silence() -> None:
    adapter = Adapter()
    adapter.hears(3, every=2)
    adapter.total = 0
    assert all(adapter.hears(3, every=2))
