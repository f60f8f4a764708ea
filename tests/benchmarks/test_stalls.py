"""The experiment's stalls are what the documentation says, and what was wrong under them is told rightly."""

from __future__ import annotations

import random
from itertools import pairwise
from typing import Any

import pytest

from benchmarks.paper.measure import spec_of
from benchmarks.paper.robot import REVISES
from benchmarks.paper.stalled import WAYS
from benchmarks.paper.stalls import LINKS, LONGEST, SHORTEST, Stall, passing, schedule
from benchmarks.paper.truth import Said, Wrong, in_order, judged, sayings, wrong_ones
from oracle_server.specfiles.load import parse_spec
from tests.brute import truths

NAME = ("uav1", 1, "p")
SPEC = """
id: lamp
streams:
  - {topic: /switch, signals: {on: msg.on}}
  - {topic: /light, signals: {lit: msg.lit}}
properties:
  - {id: lit_when_on, formula: '{topic: "/light", lit} -> once[:3]{topic: "/switch", on}'}
  - {id: switched, formula: 'once{topic: "/switch", on}'}
"""


@pytest.mark.parametrize("seed", range(1, 21))
def test_each_run_has_ten_stalls_and_no_link_two_at_a_time(seed: int) -> None:
    stalls = schedule(seed)
    assert len(stalls) == 10
    assert all(SHORTEST <= s.end - s.start <= LONGEST for s in stalls)
    for link in LINKS:
        assert all(a.end < b.start for a, b in pairwise(s for s in stalls if s.is_on(link)))
    assert schedule(seed) == stalls != schedule(seed + 1)


def test_seed_0_has_no_stalls() -> None:
    assert schedule(0) == []


def test_what_falls_into_a_stall_of_its_link_passes_at_its_end() -> None:
    stalls = [own := Stall(1.0, 1.5, "battery"), every := Stall(2.0, 2.25, "all")]
    assert passing(0.75, "battery", stalls) == (0.75, None)
    assert passing(1.0, "battery", stalls) == (1.5, own)
    assert passing(1.5, "battery", stalls) == (1.5, None)
    assert passing(1.25, "supervisor", stalls) == (1.25, None)
    assert passing(2.125, "supervisor", stalls) == (2.25, every)


@pytest.mark.parametrize("way", [way for way, changes in WAYS.items() if not any(REVISES in new for _, new in changes)])
def test_each_way_of_judging_is_a_sound_spec(way: str) -> None:
    assert parse_spec(spec_of(WAYS[way]), "").spec != parse_spec(spec_of(()), "").spec


def record(n: int, at: int, outcome: str, name: tuple[str, int, str] = NAME, **more: object) -> dict[str, Any]:
    monitor, seq, prop = name
    said = {"n": n, "judged": at, "outcome": outcome, "monitor": monitor, "seq": seq, "property": prop, "kind": "topic"}
    return said | more


def revision(n: int, at: int, outcome: str, first: int, last: int, prop: str = "p") -> dict[str, Any]:
    said: dict[str, Any] = {"n": n, "judged": at, "outcome": outcome, "property": prop, "kind": "revision"}
    return said | {"revises": {"from": first, "to": last}}


def test_a_revision_is_of_one_property_and_of_the_records_that_it_names() -> None:
    names = [("uav1", seq, prop) for seq in (1, 2, 3) for prop in ("p", "q")]
    records = [record(n, n, "currently_true", name) for n, name in enumerate(names, 1)]
    said = sayings([*records, revision(7, 70, "currently_false", 3, 5)])
    revised = {name for name, of in said.items() if of[1:]}
    assert revised == {("uav1", 2, "p"), ("uav1", 3, "p")}
    assert said["uav1", 2, "p"] == [Said(3, holds=True), Said(70, holds=False)]


@pytest.mark.parametrize(
    ("said", "wrong"),
    [
        ([(1, True)], None),
        ([(1, None)], None),
        ([(1, False)], Wrong(NAME, said=False, lasted=None)),
        ([(1, False), (5, True)], Wrong(NAME, said=False, lasted=4)),
        ([(1, False), (5, True), (7, False), (10, True)], Wrong(NAME, said=False, lasted=7)),
        ([(1, True), (5, False)], Wrong(NAME, said=False, lasted=None)),
        ([(1, False), (5, None)], Wrong(NAME, said=False, lasted=4)),
    ],
)
def test_a_verdict_is_wrong_until_it_is_put_right_or_for_good(
    said: list[tuple[int, bool | None]], wrong: Wrong | None
) -> None:
    found = wrong_ones({NAME: [Said(at, holds) for at, holds in said]}, {NAME: True})
    assert found == ([] if wrong is None else [wrong])


@pytest.mark.parametrize("seed", range(10))
def test_the_truth_is_what_a_literal_reading_of_the_sorted_events_says(seed: int) -> None:
    chance = random.Random(seed)
    lines = []
    for seq in range(1, 30):
        stream, signal = chance.choice([("/switch", "on"), ("/light", "lit")])
        line = {"stream": stream, "kind": "topic", "monitor": "m", "seq": seq, "stamp": chance.randrange(20) + 1}
        line |= {"arrived": 100 + seq, "source": "", "call": None, "ask": False, "failed": []}
        lines.append(line | {"signals": {signal: chance.random() < 0.5}})
    spec = parse_spec(SPEC, "").spec
    ordered = in_order(lines)
    assert [(line["stamp"], line["seq"]) for line in ordered] == sorted((e["stamp"], e["seq"]) for e in lines)
    steps: list[Any] = [(e["stamp"], {**e["signals"], "topic": e["stream"], "monitor": "m"}) for e in ordered]
    found = judged(spec, ordered)
    for prop in spec.properties:
        literal = truths(prop.formula, steps, prop.time)
        assert [found["m", e["seq"], prop.id] for e in ordered] == literal
