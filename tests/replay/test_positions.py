"""Positions that a trace passes over: many take little memory."""

from __future__ import annotations

import random
import tracemalloc

from oracle_server.replay.traces.positions import Positions


def test_it_has_what_was_added() -> None:
    numbers = random.Random(1)
    positions, known = Positions(), set[int]()
    for _ in range(2000):
        number = numbers.randrange(20_000)
        positions.update([number])
        known.add(number)
    positions.update([2**63])
    assert [n for n in range(20_000) if n in positions] == sorted(known)
    assert 2**63 in positions
    assert 2**63 + 1 not in positions


def test_a_million_that_follow_each_other_take_little_memory() -> None:
    positions = Positions()
    tracemalloc.start()
    positions.update(range(1, 1_000_001))
    taken, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert taken < 2**20
    assert 1_000_000 in positions
