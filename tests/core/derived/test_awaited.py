"""Obligations over derived signals in sessions, against both tables read literally: of these signals, and of those.

    CASES=50000 pytest tests/core/derived/test_awaited.py

is the long run. A case is told by its number alone.
"""

from __future__ import annotations

import os
import random
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

import pytest

from oracle_server.core.atoms import canonical
from oracle_server.core.events import TICKS, By, Event, StreamKey
from oracle_server.core.formula.ahead import looks_ahead, obligation
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.plan import plan
from oracle_server.core.spec import SECOND, Property
from oracle_server.core.verdicts import Judged, Outcome, record
from oracle_server.specfiles.load import parse_spec
from tests.brute import Values
from tests.core.derived.cases import (
    LIMITS,
    Case,
    case,
    distinct,
    event_of,
    interleaved,
    judged,
    opened,
    restarted,
)
from tests.core.derived.expected import Expected
from tests.engines.test_against_brute import SEED
from tests.obligations import Item, decisions

CASES = int(os.environ.get("CASES", "320"))
Told = dict[tuple[int, str], str]
"""What became of obligations: by the number of the step, from 0, and the values as text."""


def owing(rng: random.Random, time: Time, *, by: By = "arrival", undo: bool = False) -> Case:
    """A case of which all properties but the first one wait for what comes."""
    found = case(rng, time, by=by, undo=undo, most=10)
    first, *_ = found.spec.properties
    names = [d.name for d in found.spec.derive]
    steady = [d.name for d in found.spec.derive if d.op != "age"]
    properties = [_obligation(rng, f"o{n}", time, names, steady) for n in range(rng.randint(1, 2))]
    return replace(found, spec=replace(found.spec, properties=(first, *properties)))


def _obligation(rng: random.Random, name: str, time: Time, names: Sequence[str], steady: Sequence[str]) -> Property:
    scoped = rng.random() < 0.5

    def atom(*, bound: bool = scoped) -> str:
        d = rng.choice(names)
        limit, op = rng.choice(LIMITS), rng.choice(("<", "<=", ">", ">=", ":", "!="))
        free = (f"{{{d} {op} {limit}}}",) * 3 + (f"{{{d}: *}}", "{x > 2}", f"{{topic: /b, {d} > 1}}", f"{{x <= {d}}}")
        keyed = ("{k: *v}", f"{{k: *v, {d} > 1}}", "{h: *v}", *(f"{{{each}: *v}}" for each in steady))
        return rng.choice(keyed if bound and rng.random() < 0.5 else free)

    def compared() -> str:
        return f"{{{rng.choice((*names, 'x'))} {rng.choice(('<', '<=', '>', '>='))} *v}}" if scoped else atom()

    def span() -> str:
        lower, upper = sorted(rng.choices(range(4), k=2))
        unit = "" if time == "steps" else "s"
        return rng.choice((f"[:{upper}{unit}]", f"[{lower}{unit}:{upper}{unit}]", f"[:{upper}{unit}]"))

    def goal(depth: int) -> str:
        if not depth:
            return rng.choice(
                (atom(), compared(), f"not {atom()}", f"once{span()} {atom()}", f"({atom()} or {atom()})")
            )
        kind = rng.choice(("eventually", "always", "until", "next", "and"))
        if kind == "until":
            return f"({goal(depth - 1)} until{span()} {goal(depth - 1)})"
        if kind == "and":
            return f"({goal(depth)} and {goal(depth - 1)})"
        return f"{kind}{'' if kind == 'next' else span()} {goal(depth - 1)}"

    asked = rng.choice(("{k: *v}", "{x: *v}", *(f"{{{each}: *v}}" for each in steady))) if scoped else ""
    more = rng.choice((atom(), "{topic: /a}", f"once[:2] {atom()}", "true"))
    head = f"forall[v]. {asked} and {more}" if scoped else more
    text = f"{head} -> {goal(rng.choice((1, 1, 2)))}"
    formula = parse_formula(text, time)
    return (
        Property(name, formula, text, time=time)
        if looks_ahead(formula)
        else _obligation(rng, name, time, names, steady)
    )


class Table:
    """What the tables say of a case, as far as a session has judged it."""

    def __init__(self, found: Case) -> None:
        self._expected = Expected(found, judge=False)
        self._case, self._items = found, list[Item]()
        self._done: dict[str, Told] = {}
        self._seen: dict[str, list[int]] = {}
        """Of each property the items that are known to it: a tick that decides nothing leaves nothing behind."""

    def check(self, one: Judged, stats: Counter[str]) -> None:
        """Compare what was judged next."""
        tick = one.step.event.stream == TICKS
        if not tick:
            self.idle(one.step.time - 1)
        if one.number is None and not tick:  # it was taken back
            return
        if tick:
            self._items.append(Item(one.step.time, None))
        else:
            step = self._expected.take(one.step.event.seq - 1)
            self._items.append(Item(step.time, step.seen, frozenset(step.failed)))
        for prop, verdict in zip(self._case.spec.properties, one.verdicts, strict=True):
            if not looks_ahead(prop.formula):
                continue
            known, done = self._known(prop, [len(self._items) - 1]), self._done.setdefault(prop.id, {})
            new = {at: value for at, value in known.items() if value != "open" and at not in done}
            told = f"{prop.text}, {prop.time}, at {one.step.stamp}: {self._items}"
            about = [(each["step"] - 1, _text(each["values"])) for each in record(one, verdict).get("about", ())]
            assert sorted(about) == sorted(at for at, value in new.items() if value == "false"), told
            assert verdict.pending == sum(value == "open" for value in known.values()), told
            if about:
                assert verdict.outcome is Outcome.CURRENTLY_FALSE, told
            done |= new
            if new or not tick:
                self._seen.setdefault(prop.id, []).append(len(self._items) - 1)
            if tick and new:
                self._items.append(Item(one.step.time - 1, None))
                early = self._known(prop, [len(self._items) - 1], but=[len(self._items) - 2])
                assert any(early[at] == "open" for at in new), f"it could be known before: {told}"
                self._items.pop()
            stats.update(new.values())
            stats["at ticks"] += len(new) if tick else 0

    def idle(self, time: int) -> None:
        """Until a time nothing more is decided."""
        self._items.append(Item(time, None))
        for prop in self._case.spec.properties:
            if looks_ahead(prop.formula):
                known, done = self._known(prop, [len(self._items) - 1]), self._done.get(prop.id, {})
                missed = {at for at, value in known.items() if value != "open"} - done.keys()
                assert not missed or prop.time == "steps", (prop.text, missed, self._items)
        self._items.pop()

    def _known(self, prop: Property, more: Sequence[int], but: Sequence[int] = ()) -> Told:
        found = obligation(prop.formula)
        assert found is not None
        items = [self._items[n] for n in (*(n for n in self._seen.get(prop.id, ()) if n not in but), *more)]
        values = {canonical(v): v for item in items for v in (item.signals or {}).values()}
        keys: list[Values] = (
            [{name: v} for name in found.variables for v in values.values()] if found.variables else [{}]
        )
        known = decisions(prop.formula, items, prop.time, keys)
        return {(i, _text(keys[k])): value for (i, k), value in known.items()}


def _text(values: Values) -> str:
    return " ".join(canonical(v) for v in values.values())  # type: ignore[arg-type]


def compare(found: Case, rows: Sequence[Judged], stats: Counter[str], end: int | None = None) -> None:
    """Compare what a session has judged, until a time."""
    table = Table(found)
    for one in rows:
        table.check(one, stats)
    if end is not None:
        table.idle(end)


def check_plain(rng: random.Random, time: Time, stats: Counter[str]) -> None:
    """Each event arrives at its stamp."""
    found = owing(rng, time)
    compare(found, judged(found), stats, found.end - 1)


def check_undone(rng: random.Random, time: Time, stats: Counter[str]) -> None:
    """Events of a stream are taken back where they are denied."""
    found = owing(rng, time, undo=True)
    rows = judged(found)
    stats["taken back"] += sum(one.number is None and one.step.event.stream != TICKS for one in rows)
    compare(found, rows, stats, found.end - 1)


def check_permuted(rng: random.Random, time: Time, stats: Counter[str]) -> None:
    """All events arrive late, those of different streams in any order, and are judged in that of their stamps."""
    found = distinct(owing(rng, time, by="publication"))
    session = opened(plan(found.spec), found.begun)
    rows = session.attach("m", found.spec.by_key, found.begun)
    for index in interleaved(found, rng):
        rows += session.ingest(event_of(found, index, arrived=found.end))
    compare(found, rows + session.finish(found.end), stats)


def check_restarted(rng: random.Random, time: Time, stats: Counter[str]) -> None:
    """The session is saved and restored at some places, and judged again from its beginning at others."""
    found = owing(rng, time)
    rows, restarts = restarted(found, rng)
    stats["restarts"] += restarts
    compare(found, rows, stats, found.end - 1)


def check_both(rng: random.Random, time: Time, stats: Counter[str]) -> None:
    """Both orders are judged side by side."""
    found = distinct(owing(rng, time, by="both"))
    places = interleaved(found, rng)
    session = opened(plan(found.spec), found.begun)
    rows = session.attach("m", found.spec.by_key, found.begun)
    for index in places:
        rows += session.ingest(event_of(found, index, arrived=found.end))
    rows += session.finish(found.end)
    compare(found, [j for j in rows if j.order == "publication"], stats)
    events = list(found.events)
    for index in places:
        events[index] = (found.end, *events[index][1:])
    arrived = [j for j in rows if j.order == "arrival"]
    compare(replace(found, events=tuple(events)), arrived, stats)


WAYS = {
    "plain": check_plain,
    "undone": check_undone,
    "permuted": check_permuted,
    "restarted": check_restarted,
    "both": check_both,
}


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize("way", WAYS)
def test_a_session_says_what_both_tables_say(way: str, time: Time) -> None:
    stats = Counter[str]()
    for number in range(SEED, SEED + CASES // len(WAYS)):
        try:
            WAYS[way](random.Random(f"awaited {way} {time} {number}"), time, stats)
        except AssertionError as error:
            raise AssertionError(f"case {number}, {way}, {time}: {error}") from error
    assert min(stats["true"], stats["false"]) > 0
    assert way in ("permuted", "both") or (stats["at ticks"] > 0) is (time == "seconds")
    assert (stats["taken back"] > 0) is (way == "undone")
    assert (stats["restarts"] > 0) is (way == "restarted")


SPEC = """
id: t
ordering: {by: arrival}
streams:
  - {topic: /scan}
  - {topic: /goal, signals: {goal: msg.id}}
derive:
  scans: {count: '{topic: /scan}', over: 2s}
  silence: {age: '{topic: /scan}'}
properties:
  - {id: p, formula: 'forall[g]. {goal: *g} -> eventually[:3s] {scans >= 3}', time: seconds}
  - {id: q, formula: 'forall[g]. {goal: *g} -> always[:3s] {silence < 2}', time: seconds}
"""
SCAN, GOAL = StreamKey("/scan", "topic"), StreamKey("/goal", "topic")


def texts(judged: Judged) -> dict[str, str]:
    """What is said of each violation."""
    return {v.property: v.explanation.text or "" for v in judged.verdicts if v.explanation is not None}


def test_time_alone_turns_no_operand() -> None:
    ready = plan(parse_spec(SPEC, "test").spec)
    session = opened(ready, 0)
    rows = session.ingest(Event(GOAL, "m", 1, SECOND, SECOND, {"id": "g"}))
    rows += session.ingest(Event(SCAN, "m", 2, 2 * SECOND, 2 * SECOND, {}))
    assert session.next_deadline == 4 * SECOND + 1 + 1, "that of the obligations, with a tick's wait"
    (tick,) = session.advance(60 * SECOND)
    assert tick.step.stamp == 4 * SECOND + 1
    found = [record(tick, v) for v in tick.verdicts]
    assert [(r["outcome"], r["about_count"], r["pending"]) for r in found] == [
        ("currently_false", 1, 0), ("currently_true", 0, 0)
    ]  # fmt: skip
    assert texts(tick)["p"].endswith("at none of 2 steps until 4.000 s"), "of the tick nothing is judged"
    late = session.ingest(Event(GOAL, "m", 3, 61 * SECOND, 61 * SECOND, {"id": "h"}))
    assert record(late[0], late[0].verdicts[1])["about"][0]["signals"]["silence"] == 59
    assert texts(late[0])["q"].endswith(
        "it fails at this step; {silence < 2}: silence = 59.0, wanted < 2, at step 3 (61.000 s); "
        "silence 59.0: {topic: /scan} last at step 2"
    )


LOSING = """
id: t
ordering: {by: arrival}
streams: [{topic: /goal, signals: {x: msg.x}}]
derive: {top: {max: x, over: 2}}
properties: [{id: p, formula: '{x: 0} -> next {top > 1}'}]
"""


def test_what_a_failed_derived_signal_would_decide_is_lost() -> None:
    session = opened(plan(parse_spec(LOSING, "test").spec), 0)
    given = [Event(GOAL, "m", n, n, n, {"x": x}) for n, x in enumerate((0, "no number", 0, 2), 1)]
    rows = [row for event in given for row in session.ingest(event)]
    found = [record(row, row.verdicts[0]) for row in rows]
    assert [(r["outcome"], r["about_count"], r["pending"]) for r in found] == [
        ("currently_true", 0, 1), ("unknown", 0, 0), ("unknown", 0, 1), ("currently_true", 0, 0)
    ]  # fmt: skip
    assert found[-1]["degraded"]
