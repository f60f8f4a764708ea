"""Random specs that revise and have derived signals, and events of theirs that come late."""

from __future__ import annotations

import itertools
import random
from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

from oracle_server.core.derived.definition import Definition
from oracle_server.core.events import Event
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from tests import generate
from tests.core.derived.cases import GAPS, SIGNALS, STREAMS, data_of, definition_of, property_of
from tests.core.revising import Case
from tests.strategies import SECOND, START

NAMES = {**SIGNALS, "/u": ("x", "k")}
UNORDERED = StreamSpec("/u", signals={name: f"msg.{name}" for name in NAMES["/u"]}, ordered=False)
LATENESS = (0, 0, 1, SECOND, 3 * SECOND, 5 * SECOND, 8 * SECOND)


def case(rng: random.Random, time: Time, *, horizon: int = 60 * SECOND) -> Case:
    """A random case; some streams without order, some events that ask, and are taken back."""
    definitions = [_often_by_key(rng)]
    for i in range(1, rng.randint(1, 4)):
        definitions.append(definition_of(rng, f"d{i}", definitions))
    properties = [property_of(rng, i, definitions, time) for i in range(rng.randint(1, 3))]
    properties = [_varied(rng, prop, time) for prop in properties]
    asks = rng.random() < 0.5
    if asks:
        blame: Literal["any", "caused"] = rng.choice(("any", "caused"))
        properties[0] = replace(properties[0], guards=frozenset({"/b"}), blame=blame)
    undo: Literal["undo", "keep"] = "undo" if asks and rng.random() < 0.7 else "keep"
    streams = tuple(
        replace(s, action="filter", on_deny=undo) if asks and s.name == "/b" else s for s in (*STREAMS, UNORDERED)
    )
    ordering = Ordering(max_delay=2 * SECOND, late="revise", horizon=horizon)
    spec = Spec("s", streams, tuple(properties), ordering, derive=tuple(definitions))
    return Case(spec, list(events(rng, spec)))


def _often_by_key(rng: random.Random) -> Definition:
    drawn = [definition_of(rng, "d0", []) for _ in range(6)]
    return max(drawn, key=lambda found: found.by != () and found.changes) if rng.random() < 0.5 else drawn[0]


def _varied(rng: random.Random, prop: Property, time: Time) -> Property:
    """The property, at times latched, or with its formula under an operator that looks back."""
    if rng.random() < 0.3:
        around = _around(rng, prop.formula, time)
        prop = replace(prop, formula=around, text=render(around, time))
    return replace(prop, latch=rng.random() < 0.15)


def _around(rng: random.Random, formula: Formula, time: Time) -> Formula:
    bound, other = generate.bound(rng, time), rng.choice((parse_formula("{topic: /b}"), parse_formula("{k: u}")))
    return rng.choice(
        (
            tree.Once(formula, bound),
            tree.Historically(formula, bound),
            tree.Since(formula, other, bound),
            tree.Since(other, formula, bound),
            tree.Or(tree.Pre(formula), other),
        )
    )


def events(rng: random.Random, spec: Spec) -> Iterator[Event]:
    """Events of two monitors, some of which come up to 8 s after they were published."""
    at, made = START - rng.choice((0, 0, SECOND)), []
    streams = [*spec.streams[:3], *spec.streams[:3], *([UNORDERED] if rng.random() < 0.4 else [])]
    for i in range(rng.randint(3, 14)):
        at += rng.choice(GAPS)
        stream = rng.choice(streams)
        made.append((at + (rng.choice(LATENESS) if stream.ordered else 0), i, stream, at))
    seqs = {monitor: itertools.count(1) for monitor in "mn"}
    for arrived, _, stream, stamp in sorted(made, key=lambda each: each[:2]):
        monitor = rng.choice("mn")
        data = data_of(rng, NAMES[stream.name])
        ask = stream.action == "filter"
        yield Event(stream.key, monitor, next(seqs[monitor]), stamp, arrived, data, source=str(arrived), ask=ask)
