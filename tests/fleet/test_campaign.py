"""A short campaign; `python -m tests.fleet` is a long one. And what it looks at sees what is wrong."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from tests.chaos.conftest import chance
from tests.fleet.campaign import run_round
from tests.fleet.cluster import SPOILING, Cluster, Fault
from tests.fleet.rulings import Ruling, two_at_once
from tests.history.backends import postgres
from tests.postgres import Postgres

__all__ = ["chance", "postgres"]

SESSIONS, EVENTS = 4, 200


@pytest.mark.parametrize(
    "faults",
    [
        (Cluster.one_is_killed, Cluster.monitors_are_cut_off, Cluster.one_stands_until_another_has_taken_over,
         Cluster.one_stands_for_a_moment, Cluster.two_are_killed, Cluster.monitors_are_cut_off),
        (Cluster.the_relay_cuts, Cluster.one_is_killed, Cluster.connections_to_postgresql_end, Cluster.the_relay_cuts,
         Cluster.one_stands_for_a_moment, Cluster.connections_to_postgresql_end, Cluster.monitors_are_cut_off),
        (Cluster.one_does_not_reach_postgresql, Cluster.the_relay_cuts, Cluster.postgresql_is_killed,
         Cluster.connections_to_postgresql_end, Cluster.postgresql_and_one_are_killed, Cluster.one_is_killed,
         Cluster.postgresql_is_killed_as_monitors_come_back),
    ],
    ids=["servers", "connections", "PostgreSQL"],
)  # fmt: skip
async def test_nothing_acked_is_lost_or_twice_or_otherwise_and_none_decide_together(
    faults: tuple[Fault, ...], postgres: Postgres, tmp_path: Path, chance: random.Random
) -> None:
    count = await run_round(postgres, tmp_path, SESSIONS, faults, chance, events=EVENTS)
    assert count.faults.total() == len(faults)
    assert count.moves > 0
    assert count.unknown == 0 or not SPOILING.isdisjoint(faults)


def test_two_that_decide_at_once_are_seen() -> None:
    def decided(*asked: tuple[str, float]) -> list[str]:
        return two_at_once(Ruling(at, at + 1, process) for process, at in asked)

    assert decided(("a", 0), ("a", 2), ("b", 4), ("b", 6), ("c", 8)) == []
    assert decided(("a", 0), ("b", 0.5), ("a", 1.2)) == []  # b's may have been decided first
    assert decided(("a", 0), ("b", 4), ("a", 8)) == ["a, b"]
    assert decided(("a", 0), ("b", 4), ("a", 8), ("b", 12)) == ["a, b", "b, a"]
