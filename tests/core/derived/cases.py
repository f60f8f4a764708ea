"""Random specs with derived signals, and random events."""

from __future__ import annotations

import json
import random
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

from oracle_server.core.derived.compared import uncompared
from oracle_server.core.derived.definition import OPS, Definition, Op, Traits
from oracle_server.core.events import By, Event, StreamKey
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.tree import Formula
from oracle_server.core.judging.deciding import is_denied
from oracle_server.core.machines.making import by_states, by_values
from oracle_server.core.machines.sequence import by_sequence
from oracle_server.core.plan import Plan, plan
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec, orders
from oracle_server.core.verdicts import Judged
from oracle_server.engines.native import NativeEngine
from tests.core.derived.machines import SEQUENCES, noted
from tests.core.derived.reference import EXPRESSIONS, SECOND, Reference

START = 1_000 * SECOND
SIGNALS = {"/a": ("x", "k"), "/b": ("y", "z", "k"), "/c": ("k", "h")}
STREAMS = (
    StreamSpec("/a", signals={name: f"msg.{name}" for name in SIGNALS["/a"]}),
    StreamSpec("/b", signals={name: f"msg.{name}" for name in SIGNALS["/b"]}, hold=frozenset({"y"})),
    StreamSpec("/c", signals={name: f"msg.{name}" for name in SIGNALS["/c"]}, hold=frozenset({"h"})),
)
HELD = frozenset({"y", "h"})
FORMULAS = ("{topic: /a}", "{x > 2}", "not {x > 2}", "{y: 1} or {topic: /b}", "{topic: /b, z: *}", "{h: 1}")
EVENTS = ("{topic: /a, x > 1}", "{topic: /b}", "{topic: /b, z: *}", "{x: 1}", "{y > 1}", "{topic: /c, h: 1}", "{k: u}")
FOLLOWED = ("1", "2", "3", "0.1", "w", "true")
PLAIN = Traits()
VALUES: tuple[Any, ...] = (1, 2, 3, 0.1, 2.5, -4, 1e16, 3, 1, 2)
ODD: tuple[Any, ...] = ("w", True, {}, None, None, 1)
GAPS = (0, 1, SECOND // 2, SECOND - 1, SECOND, SECOND + 1, 2 * SECOND)
OVERS = (1, SECOND, SECOND + 1, 2 * SECOND, 5 * SECOND)
LIMITS = (0, 1, 1.5, 2, 3, 0.5, 6)


@dataclass(frozen=True)
class Case:
    """A spec, when its session began, and its events: their times, streams and data."""

    spec: Spec
    begun: int
    events: tuple[tuple[int, str, Mapping[str, Any]], ...]

    @property
    def end(self) -> int:
        """When all of it is over."""
        return max([self.begun, *(time for time, _, _ in self.events)]) + 7 * SECOND

    @property
    def reference(self) -> Reference:
        """What its derived signals are."""
        return Reference(self.spec.derive, SIGNALS, HELD)


def case(rng: random.Random, time: Time, *, by: By = "arrival", undo: bool = False, most: int = 14) -> Case:
    """A random case; with `undo` events on /b are asked about, and taken back where they are denied."""
    definitions: list[Definition] = []
    for i in range(rng.randint(1, 4)):
        definitions.append(definition_of(rng, f"d{i}", definitions))
    properties = [property_of(rng, i, definitions, time) for i in range(rng.randint(1, 4))]
    streams: tuple[StreamSpec, ...] = STREAMS
    if undo:
        properties[0] = replace(properties[0], guards=frozenset({"/b"}))
        streams = tuple(replace(s, action="filter", on_deny="undo") if s.name == "/b" else s for s in STREAMS)
    ordering = Ordering(by=by, max_delay=100 * SECOND, max_skew=SECOND)
    spec = Spec("s", streams, tuple(properties), ordering, derive=tuple(definitions))
    at = START
    events = []
    for _ in range(rng.randint(0, most)):
        at += rng.choice(GAPS)
        name = rng.choice(tuple(SIGNALS))
        events.append((at, name, data_of(rng, SIGNALS[name])))
    return Case(spec, START - rng.choice((0, 0, SECOND, 3 * SECOND)), tuple(events))


def definition_of(rng: random.Random, name: str, above: Sequence[Definition]) -> Definition:
    """A derived signal of any kind, which may be computed of those above it."""
    derived = [d.name for d in above if d.op != "age"]
    names = ["x", "y", "z", "h", *derived]
    op: Op = rng.choice(("expression", *OPS))
    if OPS.get(op, PLAIN).machine:
        return _machine_of(rng, name, op, names, derived)
    if op == "expression":
        text = rng.choice(EXPRESSIONS)
        return Definition(name, op, text.format(*rng.sample(names, text.count("{}"))))
    traits = OPS[op]
    formula = _formula(rng.choice((*FORMULAS, *(f"{{{d} > 1}}" for d in derived)))) if traits.formula else None
    counted = traits.window and op != "rate" and rng.random() < 0.4
    over = None if not traits.window else rng.randint(1, 3) if counted else rng.choice(OVERS)
    by = rng.choice(((), (), ("k",), ("k",), ("h",))) if name != "d0" or rng.random() < 0.5 else ()
    may_forget = bool(by) and (traits.lasting or (counted and not traits.formula))
    forget = rng.choice((None, 2 * SECOND, 1)) if may_forget else None
    return Definition(name, op, "" if formula else rng.choice(names), formula, over, counted, by, forget)


def parametric_case(rng: random.Random, time: Time, *, by: By = "arrival", undo: bool = False) -> Case:
    """A case of one machine that several signals tell apart, whose values come again and again."""
    keys = rng.choice((("k", "x"), ("k", "h"), ("x", "z"), ("k", "x", "h")))
    op: Op = rng.choice(("states", "follows", "sequence"))
    machine = _machine_of(rng, "d0", op, ("y", "z"), (), keys)
    plain = case(rng, time, by=by, undo=undo, most=0)
    properties = [property_of(rng, i, [machine], time) for i in range(3)]
    properties[0] = replace(properties[0], guards=plain.spec.properties[0].guards)
    at = START
    events: list[tuple[int, str, Mapping[str, Any]]] = []
    for _ in range(rng.randint(4, 30)):
        at += rng.choice(GAPS)
        name = rng.choice(tuple(SIGNALS))
        data = {each: rng.choice(("u", "v") if each == "k" else (1, 2)) for each in SIGNALS[name]}
        kept = {each: value for each, value in data.items() if rng.random() < 0.85}
        events.append((at, name, {each: value if rng.random() < 0.98 else {} for each, value in kept.items()}))
    return Case(replace(plain.spec, properties=tuple(properties), derive=(machine,)), plain.begun, tuple(events))


def _machine_of(
    rng: random.Random,
    name: str,
    op: Op,
    names: Sequence[str],
    derived: Sequence[str],
    by: tuple[str, ...] | None = None,
) -> Definition:
    """A machine of any kind; `of` has what the reference reads of it."""
    by = rng.choice(((), ("k",), ("h",), ("k", "x"), ("k", "h"))) if by is None else by
    forget = rng.choice((None, 2 * SECOND, 1)) if by else None
    if op == "follows":
        of = rng.choice(names)
        values = rng.sample(FOLLOWED, rng.randint(1, 4))
        successors = {value: rng.sample(values, rng.randint(0, len(values))) for value in values}
        return Definition(name, op, of, by=by, forget=forget, table=noted(by_values(successors), successors))
    formulas = {f"e{i}": text for i, text in enumerate(rng.sample(EVENTS, 3))}
    if derived and rng.random() < 0.3:
        formulas["e0"] = f"{{{rng.choice(derived)}: *}}"
    if op == "sequence":
        text = rng.choice(tuple(SEQUENCES))
        table = noted(by_sequence(text, formulas), SEQUENCES[text])
    else:
        states = ("a", "b", "c", *(("error",) if rng.random() < 0.3 else ()))
        lots = {state: rng.sample(sorted(formulas), rng.randint(0, 3)) for state in states}
        rows = {state: {event: rng.choice((*states, "error")) for event in lot} for state, lot in lots.items()}
        otherwise = rng.choice(("error", "error", "stay", "a"))
        table = noted(by_states(rows, "a", otherwise), (rows, otherwise))
    events = tuple(_formula(formulas[event]) for event in table.events)
    return Definition(name, op, "", by=by, forget=forget, table=table, events=events)


def property_of(rng: random.Random, index: int, definitions: Sequence[Definition], time: Time) -> Property:
    """A property that asks something of a derived signal."""
    of = rng.choice(definitions)
    if rng.random() < 0.3:
        found = _comparison(rng, index, of, definitions, time)
        if not [*uncompared(Spec("s", STREAMS, (found,), derive=tuple(definitions)))]:
            return found
    where = rng.choice(("", "", "", "topic: /b, "))
    if of.table is not None:
        value = json.dumps(rng.choice([value for value in of.table.values if value]))
        text = f"{rng.choice(('', 'not '))}{{{where}{of.name}{rng.choice((f': {value}', f' != {value}', ': *'))}}}"
        return Property(f"p{index}", _formula(text), text, time=time)
    what = rng.choice((*(f"{of.name} {op} {rng.choice(LIMITS)}" for op in ("<", "<=", ">", ">=", ":", "!=")),
                       f"{of.name}: *"))  # fmt: skip
    text = f"{rng.choice(('', 'not '))}{{{where}{what}}}"
    return Property(f"p{index}", _formula(text), text, time=time)


def _comparison(
    rng: random.Random, index: int, of: Definition, definitions: Sequence[Definition], time: Time
) -> Property:
    """A property that compares a derived signal with another signal; `check` may refuse it."""
    others = [name for name in ("y", "h", "y", "h", "z", *(d.name for d in definitions)) if name != of.name]
    sides = [of.name, rng.choice(others)]
    rng.shuffle(sides)
    where = rng.choice(("", "", "", "topic: /b, "))
    text = f"{rng.choice(('', 'not '))}{{{where}{sides[0]} {rng.choice(('<', '<=', '>', '>='))} {sides[1]}}}"
    return Property(f"p{index}", _formula(text), text, time=time)


@cache
def _formula(text: str) -> Formula:
    return parse_formula(text)


def data_of(rng: random.Random, names: Sequence[str]) -> Mapping[str, Any]:
    """A message with some of these signals; some of them fail."""
    data = {name: rng.choice(VALUES if rng.random() < 0.85 else ODD) for name in names}
    if "k" in data:
        data["k"] = rng.choice(("u", "v", 1, True, None, "u", "v", {}))
    return {name: value for name, value in data.items() if value is not None}


Row = tuple[str, int, tuple[str, ...]]
"""A stream, empty for ticks, the time, and the outcomes."""


def opened(ready: Plan, begun: int) -> Session:
    """A session that begins at a time."""
    spec = ready.spec
    engines = [[NativeEngine(p.formula, p.time) for p in spec.properties] for _ in orders(spec)]
    return Session(ready, engines, begun=begun)


def event_of(found: Case, index: int, *, arrived: int | None = None) -> Event:
    """An event of a case; it arrives at its stamp where nothing else is said."""
    time, name, data = found.events[index]
    stream = next(s for s in found.spec.streams if s.name == name)
    key = StreamKey(name, "topic")
    return Event(key, "m", index + 1, time, arrived or time, data, ask=stream.action == "filter")


def judged(found: Case) -> list[Judged]:
    """What a session makes of a case, each event at its time."""
    session = opened(plan(found.spec), found.begun)
    rows: list[Judged] = []
    (judge,) = session.judges.values()
    for index in range(len(found.events)):
        before = judge._derived.snapshot()
        said = session.ingest(event_of(found, index))
        rows += said
        if said and is_denied(said[-1].decision):
            assert judge._derived.snapshot() == before, "what is taken back leaves nothing behind"
    rows += session.advance(found.end)
    again = opened(session.plan, found.begun)
    again.restore(json.loads(json.dumps(session.snapshot())), 1)
    assert samples_held(session) == samples_held(again), "what counts as held is what is there"
    return rows


def samples_held(session: Session) -> int:
    """How many samples count as held, of which there may be so many."""
    return sum(judge._derived._session.budget.used for judge in session.judges.values())


def restarted(found: Case, rng: random.Random) -> tuple[list[Judged], int]:
    """The same of a session that is saved and restored at some places, some of them between ticks.

    At others it is judged again from its beginning, and must say the same. Returns how often it began anew, too.
    """
    ready, rows, count = plan(found.spec), list[Judged](), 0
    session = opened(ready, found.begun)
    for index, (time, _, _) in enumerate(found.events):
        how = rng.choice(("", "", "saved", "again"))
        if (due := session.next_deadline) is not None and due < time and rng.random() < 0.5:
            rows += session.advance(due)
        if how == "saved":
            data = json.loads(json.dumps(session.snapshot()))
            session = opened(ready, found.begun)
            session.restore(data, len(rows) * len(found.spec.properties) + 1)
        if how == "again":
            session = opened(ready, found.begun)
            again = [session.rejudge("arrival", j.step, j.judged) for j in rows]
            assert [j.verdicts for j in again if j is not None] == [j.verdicts for j in rows]
        count += how != ""
        rows += session.ingest(event_of(found, index))
    return rows + session.advance(found.end), count


def rows_of(found: Sequence[Judged]) -> list[Row]:
    """What was judged, as data."""
    return [(j.step.event.stream.name, j.step.stamp, tuple(v.outcome.current.value for v in j.verdicts)) for j in found]


def interleaved(found: Case, rng: random.Random) -> list[int]:
    """The places of the events in another order, in which each stream has its own one."""
    streams = [stream for _, stream, _ in found.events]
    queues = {name: [i for i, stream in enumerate(streams) if stream == name] for name in streams}
    rng.shuffle(streams)
    return [queues[name].pop(0) for name in streams]


def distinct(found: Case) -> Case:
    """The case with stamps that are all different: equal ones are judged as they arrive."""
    events = tuple((time + i, *rest) for i, (time, *rest) in enumerate(found.events))
    return replace(found, events=events)  # type: ignore[arg-type]
