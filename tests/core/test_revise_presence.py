"""The grace of presence properties where events come late: what stands is as if all had come in time."""

from __future__ import annotations

import os
import random
from dataclasses import replace

import msgspec

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import Outcome
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.core.revising import B, Case, Run, compared, events
from tests.core.test_revise import event
from tests.engines.test_against_brute import SEED
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "400")) // 3
STREAMS = (StreamSpec("/a"), StreamSpec("/b"), StreamSpec("/h", hold=frozenset({"c"})))
ORDERING = Ordering(max_delay=2 * SECOND, late="revise", horizon=60 * SECOND)


def presence(rng: random.Random, name: str) -> Property:
    """A property that demands that something is there every so often."""
    formula: tree.Formula = tree.Once(generate.formula(rng, "seconds", 1), tree.Bound(0, rng.randint(1, 9) * SECOND))
    if rng.random() < 0.3:
        formula = tree.And(formula, tree.Once(generate.formula(rng, "seconds", 1), tree.Bound(0, 3 * SECOND)))
    return Property(name, formula, render(formula, "seconds"), time="seconds", latch=rng.random() < 0.1)


def case(rng: random.Random) -> Case:
    """A random case, each event of which has its place."""
    properties = tuple(presence(rng, name) for name in "pq")
    keys = {stream.key for stream in STREAMS}
    return Case(Spec("s", STREAMS, properties, ORDERING), [e for e in events(rng, asks=False) if e.stream in keys])


def in_time(found: Case) -> Case:
    """The same events, as they would have come without any delay."""
    ordered = sorted(found.events, key=lambda e: e.stamp or 0)
    return found._replace(events=[msgspec.structs.replace(e, arrived=e.stamp or 0) for e in ordered])


def test_what_stands_of_a_presence_property_is_what_it_is_where_all_comes_in_time() -> None:
    revised = graced = 0
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"presence {number}")
        made = case(rng)
        if not made.events:
            continue
        run = Run(made, divided=rng.random() < 0.5, restarts=rng.choice((0, 0.15)))
        run.judge(rng)
        other = Run(in_time(made))
        for each in other.case.events:
            other.take(other.advance(each.arrived))
            other.ingest(each)
        other.take(other.advance(run.session.now))
        other.take(other.session.finish(run.session.now))
        said = f"case {number}: " + "; ".join(p.text for p in made.spec.properties)
        assert compared(run.stands()) == compared(other.stands()), said
        revised += len(run.book.revisions)
        graced += sum(Outcome.UNKNOWN in line.outcomes for line in run.stands())
    assert min(revised, graced) > CASES / 10


def test_what_comes_late_has_the_grace_of_its_place_and_the_end_of_the_grace_is_told_all_the_same() -> None:
    text = 'once[:5s]{topic: "/a"}'
    prop = Property("p", parse_formula(text, "seconds"), text, time="seconds")
    spec = Spec("s", STREAMS, (prop,), replace(ORDERING, max_delay=SECOND))
    session = Session(plan(spec), [[NativeEngine(prop.formula, "seconds")]])
    for monitor in "mn":
        session.attach(monitor, spec.by_key, SECOND)
    assert [row.verdicts[0].outcome for row in session.advance(7 * SECOND)] == ["currently_false"], "at 6 s"
    session.ingest(event(B, 1, 2_000, 9_000))
    late, *rest = session.finish(10 * SECOND)
    assert (late.place, late.verdicts[0].outcome, late.verdicts[0].explanation) == (1, "unknown", None)
    assert rest == []
    assert session.judges["publication"].properties[0].violations == 1
