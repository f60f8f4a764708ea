"""Derived signals against the reference: both clocks, arrival in any order, undo, restarts at any place, ticks.

    python -m tests.core.derived.test_against_reference 50000     # so many cases a clock and way, by hand

prints how many differ, and the first that does; `--seed` begins elsewhere, `--way` takes one way.
"""

from __future__ import annotations

import argparse
import random
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.formula.parse import Time
from oracle_server.core.plan import plan
from tests.core.derived.cases import (
    Case,
    Row,
    case,
    distinct,
    event_of,
    interleaved,
    judged,
    opened,
    parametric_case,
    restarted,
    rows_of,
)
from tests.core.derived.expected import Expected

CASES = {"plain": 1_600}
"""Of derived signals, a clock; with `FEWER` of each other way they are 3,000."""
FEWER = 350
OF_MACHINES = 75
"""Of machines by several signals, a clock and way."""
Make = Callable[..., Case]
Check = Callable[[random.Random, Time, Make], None]


def check_plain(rng: random.Random, time: Time, case: Make) -> None:
    """Each event arrives at its stamp."""
    found = case(rng, time)
    assert rows_of(judged(found)) == Expected(found).rows


def check_undone(rng: random.Random, time: Time, case: Make) -> None:
    """Events of a stream are taken back where they are denied."""
    found = case(rng, time, undo=True)
    assert rows_of(judged(found)) == Expected(found).rows


def check_permuted(rng: random.Random, time: Time, case: Make) -> None:
    """All events arrive late, those of different streams in any order, and are judged in that of their stamps."""
    found = distinct(case(rng, time, by="publication"))
    session = opened(plan(found.spec), found.begun)
    rows = session.attach("m", found.spec.by_key, found.begun)
    for index in interleaved(found, rng):
        rows += session.ingest(event_of(found, index, arrived=found.end))
    rows += session.finish(found.end)
    assert rows_of(rows) == before_last(Expected(found).rows)


def check_restarted(rng: random.Random, time: Time, case: Make) -> None:
    """The session is saved and restored at some places, and judged again from its beginning at others."""
    found = case(rng, time)
    assert rows_of(restarted(found, rng)[0]) == Expected(found).rows


def check_both(rng: random.Random, time: Time, case: Make) -> None:
    """Both orders are judged side by side, each with derived signals of its own."""
    found = distinct(case(rng, time, by="both"))
    places = interleaved(found, rng)
    session = opened(plan(found.spec), found.begun)
    rows = session.attach("m", found.spec.by_key, found.begun)
    for index in places:
        rows += session.ingest(event_of(found, index, arrived=found.end))
    rows += session.finish(found.end)
    published = [j for j in rows if j.order == "publication"]
    assert rows_of(published) == before_last(Expected(found).rows)
    as_arrived = tuple((found.end, *found.events[i][1:]) for i in places)
    arrived = rows_of([j for j in rows if j.order == "arrival" and j.number is not None])
    want = Expected(replace(found, events=as_arrived)).rows
    assert [row[2] for row in arrived] == [row[2] for row in want if row[0]]


WAYS: dict[str, Check] = {
    "plain": check_plain,
    "undone": check_undone,
    "permuted": check_permuted,
    "restarted": check_restarted,
    "both": check_both,
}
MAKES: dict[str, Make] = {"derived": case, "parametric": parametric_case}


def before_last(rows: list[Row]) -> list[Row]:
    """What is judged before or at the last event: no tick is, where nothing tells that time goes on."""
    last = max((i for i, row in enumerate(rows) if row[0]), default=-1)
    return rows[: last + 1]


@pytest.mark.parametrize(
    ("way", "seed"),
    [
        ("restarted", 5003258),  # a key's window was over before a lost sample ended that might have been its own
        ("undone", 5002546),  # a tick was judged between the last step and one that was taken back
    ],
)
def test_cases_that_once_differed(way: str, seed: int) -> None:
    WAYS[way](random.Random(seed), "seconds", case)


@pytest.mark.parametrize("make", MAKES.values(), ids=MAKES)
@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("way", WAYS)
def test_a_session_says_what_the_reference_says(way: str, time: Time, make: Make) -> None:
    @settings(max_examples=CASES.get(way, FEWER) if make is case else OF_MACHINES, deadline=None)
    @given(seed=st.integers(0, 2**32 - 1))
    def check(seed: int) -> None:
        WAYS[way](random.Random(seed), time, make)

    check()


def main() -> None:
    """Judge many random cases, and tell how many differ."""
    parser = argparse.ArgumentParser(description="Compare derived signals with the reference.")
    parser.add_argument("cases", type=int)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--way", choices=list(WAYS), action="append", help="only these ways")
    parser.add_argument(
        "--make", choices=list(MAKES), default="derived", help="any derived signals, or machines by several"
    )
    args = parser.parse_args()
    for way in args.way or WAYS:
        for time in ("steps", "seconds"):
            differing = []
            for seed in range(args.seed, args.seed + args.cases):
                try:
                    WAYS[way](random.Random(seed), time, MAKES[args.make])
                except AssertionError:
                    differing.append(seed)
            print(f"{way:10} {time:8} {args.cases} cases, {len(differing)} differ", *differing[:1], flush=True)


if __name__ == "__main__":
    main()
