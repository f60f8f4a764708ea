"""Derived signals that time changes, compared with other signals: ticks where a comparison turns, and nowhere else."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SECOND = 10**9
SPEC = """
id: t
ordering: {by: arrival}
streams:
  - {topic: /a, signals: {x: double(msg.x), k: string(msg.k)}}
  - {topic: /limit, signals: {limit: double(msg.x)}, hold: [limit]}
derive:
  many: {count: '{topic: /a}', over: 10s}
  few: {count: '{topic: /a, x > 5}', over: 3s}
  old: {age: '{topic: /a}'}
  older: {age: '{topic: /a, x > 5}'}
  high: {max: x, over: 3s}
  low: {min: x, over: 10s}
  own: {count: '{topic: /a}', over: 10s, by: k}
  lately: {count: '{topic: /a, x > 5}', over: 3s, by: k}
  since: {age: '{topic: /a}', by: k, forget: 1h}
  last_x: {last: x}
  last_k: {last: x, by: k, forget: 1h}
  twice: limit * 2
  double: many * 2
properties:
  - {id: p, formula: 'FORMULA', time: seconds}
"""


def ticks(formula: str, *events: tuple[str, float, dict[str, object]]) -> list[tuple[float, str]]:
    """When, in seconds, the outcome changed without a step, and to what, of events by their topics and seconds."""
    ready = plan(parse_spec(SPEC.replace("FORMULA", formula), "test").spec)
    session = Session(ready, make_engines(ready), begun=0)
    rows = []
    for seq, (topic, at, data) in enumerate(events, start=1):
        time = round(at * SECOND)
        rows += session.ingest(Event(StreamKey(topic, "topic"), "m", seq, time, time, data))
    rows += session.advance(100 * SECOND)
    return [(j.step.stamp / SECOND, j.verdicts[0].outcome.current.value) for j in rows if j.number is None]


def refusals(formula: str) -> list[str]:
    try:
        return [w.message for w in parse_spec(SPEC.replace("FORMULA", formula), "s.yaml").warnings]
    except SpecError as error:
        return [f"{f.line}:{f.column} {f.message}" for f in error.findings]


def a(at: float, x: float = 1, k: str = "u") -> tuple[str, float, dict[str, object]]:
    return "/a", at, {"x": x, "k": k}


def limit(at: float, x: float) -> tuple[str, float, dict[str, object]]:
    return "/limit", at, {"x": x}


def test_it_turns_where_the_held_limit_is_crossed() -> None:
    hundred = [a(n / 100) for n in range(1, 101)]
    assert ticks("not {many < limit}", limit(0, 10), *hundred) == [(10.91, "currently_false")]
    assert ticks("not {limit > many}", limit(0, 10), *hundred) == [(10.91, "currently_false")]
    assert ticks("{old <= limit}", limit(0, 2.5), a(1)) == [(3.500000001, "currently_false")]
    assert ticks("not {many < twice}", limit(0, 5), *hundred) == [(10.91, "currently_false")]
    assert ticks("{high >= last_x}", limit(0, 5), a(1, 7), a(2, 3)) == [(5, "currently_false")]


def test_the_limit_that_was_said_last_counts() -> None:
    assert ticks("{old <= limit}", limit(0, 2), a(1), limit(2, 5)) == [(6.000000001, "currently_false")]
    assert ticks("{old <= limit}", limit(0, 9), a(1), limit(2, 5), limit(3, 1)) == []


@pytest.mark.parametrize("far", [1e10, 2.0**63, 3.4028234663852886e38, 1.7976931348623157e308])
def test_a_limit_that_no_age_reaches_holds(far: float) -> None:
    """The largest number is how robots say that there is no limit."""
    assert ticks("{old <= limit}", limit(0, 2), a(1), limit(2, far)) == []
    assert ticks("{old <= limit}", limit(0, far), a(1), limit(2, 5)) == [(6.000000001, "currently_false")]
    assert ticks("forall[u]. {k: *u} -> {since < limit}", limit(0, far), a(1)) == []
    assert ticks(f"{{old < {far!r}}}", a(1)) == []
    assert ticks("not {many < limit}", limit(0, far), a(1)) == []


def test_a_limit_that_only_its_own_event_has_needs_no_tick() -> None:
    assert refusals("{topic: /a} -> {x <= many}") == []
    assert ticks("not {x > many}", a(1, 2), a(2, 1)) == []
    assert ticks("{topic: /a} -> {x <= old}", a(1, -1)) == []


def test_both_sides_change_with_time() -> None:
    """many falls by one at 11, 12 and 15, and few at 5 and 8."""
    events = a(1), a(2, 9), a(5, 9)
    assert ticks("{many > few}", *events) == [(15, "currently_false")]
    assert ticks("{few < many}", *events) == [(15, "currently_false")]
    assert ticks("{low < high}", a(1, 1), a(2, 9)) == [(5, "currently_false")]
    assert ticks("{many > old}", a(0.5), a(1), a(1.5)) == [(4.5, "currently_false")]
    assert ticks("{old < few}", a(1, 9), a(2, 9)) == [(4, "currently_false")]


def test_two_ages_stay_as_far_apart() -> None:
    assert ticks("{old >= older}", a(1), a(1.5, 9)) == []


def test_each_key_turns_by_itself() -> None:
    events = limit(0, 1.5), a(1, 1, "u"), a(2, 1, "v"), a(3, 1, "u"), a(4, 1, "v")
    assert ticks("not {own < limit}", *events) == [(11, "currently_false")]
    assert ticks("forall[u]. {k: *u} -> not {own < limit}", *events) == [(11, "currently_false")]
    assert ticks("not {own > lately}", a(1, 9, "u"), a(2, 9, "v"), a(2.5, 9, "u")) == [
        (4, "currently_false"),
        (12, "currently_true"),
    ]


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("{many > double}", "'double', which is computed of what changes with time"),
        ("{many > own}", "'own', which is kept by `k`"),
        ("{own > last_k}", "'last_k', which is kept by `k`"),
        ("{since > own}", "'own', which is kept by `k`"),
    ],
)
def test_what_would_need_a_tick_that_does_not_come_is_refused(formula: str, says: str) -> None:
    (first, *_) = refusals(formula)
    assert first.startswith("22:23 formula of 'p': ")
    assert says in first
    assert "`time: steps`" in first


@pytest.mark.parametrize("asked", ["not {near != 2}", "not {near: *}"])
def test_for_a_key_that_is_known_of_the_other_signal_alone_no_other_property_is_judged(asked: str) -> None:
    derive = "  near: {age: '{topic: /a, x > 5}', by: k, forget: 2s}\n"
    derive += "  far: {age: '{topic: /a, x < 5}', by: k, forget: 1h}\n"
    alone = SPEC.replace("derive:\n", f"derive:\n{derive}").replace("FORMULA", asked)
    both = alone + "  - {id: q, formula: '{far < near}', time: seconds}\n"
    rows = []
    for text in (alone, both):
        ready = plan(parse_spec(text, "test").spec)
        session = Session(ready, make_engines(ready), begun=0)
        lost: dict[str, object] = {"x": 9, "k": {}}
        judged = []
        for seq, (at, data) in enumerate(((1, {"x": 1, "k": "u"}), (2, lost)), start=1):
            time = at * SECOND
            judged += session.ingest(Event(StreamKey("/a", "topic"), "m", seq, time, time, data))
        judged += session.advance(100 * SECOND)
        rows.append([(j.step.stamp, j.verdicts[0].outcome) for j in judged])
    assert any(stamp == 4 * SECOND for stamp, _ in rows[1]), "the comparison turns there"
    changes = [[r for r, before in zip(found[1:], found, strict=False) if r[1] != before[1]] for found in rows]
    assert changes[0] == changes[1]
