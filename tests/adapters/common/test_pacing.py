"""Messages that come in bursts, given a few at a time."""

from __future__ import annotations

import threading
from typing import List

from oracle_adapter.pacing import AT_ONCE, PAUSE, Pacer
from tests.adapters.common.links import PATIENCE


class Clock:
    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


class Heard:
    """What was given, by which thread."""

    def __init__(self, wanted: int) -> None:
        self.numbers: List[int] = []
        self.own = 0
        self.all = threading.Event()
        self._wanted, self._thread = wanted, threading.get_ident()

    def __call__(self, number: int) -> None:
        self.numbers.append(number)
        self.own += threading.get_ident() == self._thread
        if len(self.numbers) == self._wanted:
            self.all.set()


def test_of_a_burst_a_few_are_given_at_once_and_the_rest_in_order() -> None:
    heard = Heard(100)
    pacer = Pacer(heard, Clock())
    assert all(map(pacer.take, range(100)))
    assert heard.all.wait(PATIENCE)
    assert heard.numbers == list(range(100))
    assert heard.own == AT_ONCE


def test_what_comes_slowly_is_given_by_who_brings_it() -> None:
    heard, clock = Heard(100), Clock()
    pacer = Pacer(heard, clock)
    for number in range(100):
        pacer.take(number)
        clock.now += PAUSE
    assert (heard.own, heard.numbers) == (100, list(range(100)))


def test_at_the_end_what_waits_is_given_and_nothing_more() -> None:
    heard = Heard(20)
    pacer = Pacer(heard, Clock())
    for number in range(20):
        pacer.take(number)
    pacer.stop()
    assert heard.numbers == list(range(20))
    assert not pacer.take(20)
    assert heard.numbers == list(range(20))
