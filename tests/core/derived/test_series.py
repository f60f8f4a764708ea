"""Derived signals one by one: exact sums, bounds, what is taken back, and what of it is kept."""

from __future__ import annotations

import json
import math
import random
from types import FunctionType, MethodType
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle_server.core.derived import counts, definition, extremes, keyed, sums, window
from oracle_server.core.derived.state import Derived
from oracle_server.core.events import Event, Signals, Step, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SECOND = 10**9
A = StreamKey("/a", "topic")


class One:
    """One derived signal `d` of a stream with the signals x and k, which a formula reads at each of its events."""

    def __init__(self, text: str) -> None:
        spec = f"""
id: t
streams: [{{topic: /a, signals: {{x: msg.x, k: msg.k}}}}]
derive: {{d: {text}}}
properties: [{{id: p, formula: '{{topic: /a, d: *}}'}}]
"""
        self.plan = plan(parse_spec(spec, "test").spec)
        self.derived = Derived(self.plan.derived)
        self.derived.begin(0)
        self.number = 0

    def __call__(self, time: int, signals: Signals, failed: frozenset[str] = frozenset()) -> object:
        """What it is at the next step; a text where it has failed."""
        self.number += 1
        step = Step(Event(A, "m", self.number, time, time, {}), signals, failed, time)
        found: dict[str, Any] = dict(signals)
        lost = self.derived.step(self.plan.streams[A].derives, step, found, failed, time, self.number)
        return "failed" if "d" in lost else found.get("d")

    def saved(self) -> str:
        return json.dumps(self.derived.snapshot())


FLOATS = st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from(
    (5e-324, -0.0, 0.1, 1e308, -1e308, 2.0**-1000)
)


@given(numbers=st.lists(FLOATS, max_size=60), size=st.integers(1, 8))
def test_a_sum_is_that_of_its_window_to_the_last_bit(numbers: list[float], size: int) -> None:
    one = One(f"{{sum: x, over: {size}}}")
    for n, number in enumerate(numbers):
        try:
            wanted: object = math.fsum(numbers[max(0, n + 1 - size) : n + 1])
        except OverflowError:
            wanted = None
        found = one(n, {"x": number})
        if wanted is None:  # math.fsum gives up where a part of a sum is too large, though the whole may not be
            assert found == "failed" or isinstance(found, float)
        else:
            assert (found, math.copysign(1, found)) == (wanted, math.copysign(1, wanted))  # type: ignore[arg-type]


def test_what_is_taken_back_leaves_no_trace() -> None:
    rng = random.Random(7)
    for text in (
        "{count: '{x > 1}', over: 3s}",
        "{sum: x, over: 3s}",
        "{mean: x, over: 4}",
        "{max: x, over: 3s}",
        "{last: x}",
        "{delta: x}",
        "{age: '{x > 1}'}",
        "{sum: x, over: 3s, by: k}",
        "{last: x, by: k, forget: 2s}",
        "{age: '{x > 1}', by: k, forget: 2s}",
    ):
        one, time = One(text), 0
        for _ in range(300):
            time += rng.choice((0, 1, SECOND // 2, SECOND))
            before, number = one.saved(), one.number
            one.derived.journal.mark()
            later = time
            for _ in range(rng.randint(1, 5)):
                later += rng.choice((0, SECOND, 5 * SECOND))
                one(later, {"x": rng.choice((0.1, 3, "w", 2**60)), "k": rng.choice("uvw")})
            one.derived.back()
            assert one.saved() == before, text
            one.number = number
            one(time, {"x": rng.choice((0.1, 2, 3.25)), "k": rng.choice("uv")})


def room(monkeypatch: pytest.MonkeyPatch, most: int) -> None:
    """Let the windows of a session have no more samples."""
    for module in (window, counts, sums, extremes):
        monkeypatch.setattr(module, "MAX_SAMPLES", most)


def test_a_window_without_room_fails_until_what_had_none_would_have_left(monkeypatch: pytest.MonkeyPatch) -> None:
    room(monkeypatch, 3)
    one = One("{sum: x, over: 10s}")
    assert [one(n * SECOND, {"x": 1}) for n in range(4)] == [1, 2, 3, "failed"]
    assert [one(t * SECOND, {"x": 1}) for t in (12, 13, 14)] == ["failed", 2, 3]


def test_the_windows_of_a_session_share_their_room(monkeypatch: pytest.MonkeyPatch) -> None:
    room(monkeypatch, 4)
    one = One("{sum: x, over: 10s, by: k}")
    assert [one(n, {"x": 1, "k": f"key{n}"}) for n in range(5)] == [1, 1, 1, 1, "failed"]
    assert one(11 * SECOND, {"x": 1, "k": "key0"}) == 1


def test_a_value_without_room_fails_and_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keyed, "MAX_KEYS", 2)
    one = One("{last: x, by: k, forget: 10s}")
    assert [one(n, {"x": n, "k": f"key{n}"}) for n in range(3)] == [0, 1, "failed"]
    assert one(3, {"x": 7, "k": "key0"}) == 7
    assert one(11 * SECOND, {"x": 8, "k": "key2"}) == 8


def test_the_bounds_are_those_that_are_told() -> None:
    assert (definition.MAX_SAMPLES, definition.MAX_KEYS) == (100_000, 10_000)


def held(thing: object, seen: set[int]) -> int:
    """How many elements the lists and dictionaries have that something keeps, at any depth."""
    if id(thing) in seen or isinstance(thing, str | int | float | type | FunctionType | MethodType):
        return 0
    seen.add(id(thing))
    if isinstance(thing, dict):
        return len(thing) + sum(held(value, seen) for value in thing.values())
    if isinstance(thing, list | tuple | set):
        return len(thing) + sum(held(value, seen) for value in thing)
    slots = [name for kind in type(thing).__mro__ for name in getattr(kind, "__slots__", ())]
    return sum(held(getattr(thing, name, None), seen) for name in (*slots, *getattr(thing, "__dict__", ())))


@pytest.mark.parametrize("by", ["", ", by: k"])
@pytest.mark.parametrize(
    "text",
    [
        "{count: '{topic: /a}', over: 1sBY}",
        "{rate: '{topic: /a, x > 5}', over: 1sBY}",
        "{sum: x, over: 1sBY}",
        "{mean: x, over: 100BY, forget: 2s}",
        "{min: x, over: 1sBY}",
        "{max: x, over: 100BY, forget: 2s}",
        "{last: xBY, forget: 2s}",
        "{age: '{topic: /a}'BY, forget: 2s}",
    ],
)
def test_no_more_is_kept_than_windows_hold(text: str, by: str) -> None:
    """Each window has 100 samples, or each key one; what waits to be cleared away is bounded by that."""
    one = One(text.replace("BY", by).replace("" if by else ", forget: 2s", ""))
    sizes = []
    for n in range(8_000):
        one(n * SECOND // 100, {"x": n % 17, "k": f"key{n % 500 if n % 3 else n}"})
        if n % 250 == 249:
            sizes.append(held(one.derived._series[0], set()))
    half = len(sizes) // 2
    assert max(sizes[half:]) <= 1.2 * max(sizes[:half]), "what grows with each step would have doubled"


def test_one_and_true_are_different_keys_and_seven_is_seven() -> None:
    one = One("{count: '{topic: /a}', over: 9, by: k}")
    assert [one(0, {"k": key}) for key in (1, True, 1.0, "1", 7, 7.0)] == [1, 1, 2, 1, 1, 2]


def test_a_sample_of_an_unknown_key_may_be_of_any() -> None:
    one = One("{sum: x, over: 2s, by: k}")
    assert one(0, {"x": 1, "k": "u"}) == 1
    one(SECOND, {"x": 5}, frozenset({"k"}))
    assert one(SECOND, {"x": 1, "k": "u"}) == "failed"
    assert one(2 * SECOND, {"k": "v"}) == "failed"
    assert one(3 * SECOND, {"k": "v"}) == 0
    assert one(3 * SECOND, {"x": 1, "k": "u"}) == 1


SPEC = """
id: t
ordering: {by: arrival}
streams:
  - {topic: /scan, signals: {near: msg.n}}
  - {topic: /cmd, signals: {speed: msg.v}}
  - {topic: /limit, signals: {limit: msg.v}, hold: [limit]}
derive:
  margin: limit - speed
  scan_rate: {rate: '{topic: /scan}', over: 2s}
  scan_age: {age: '{topic: /scan}'}
  nearest: {min: near, over: 3}
properties:
  - {id: slow, formula: '{topic: /cmd} -> {margin >= 0}'}
  - {id: scans, formula: 'not {scan_rate < 10}', time: seconds}
  - {id: alive, formula: '{scan_age <= 0.5}', time: seconds}
  - {id: far, formula: 'not {nearest < 1}'}
"""


class Robot:
    """A session by that spec."""

    def __init__(self) -> None:
        self.plan = plan(parse_spec(SPEC, "test").spec)
        self.session = Session(self.plan, make_engines(self.plan), begun=0)
        self.seq = 0

    def __call__(self, topic: str, time: int, **data: object) -> list[Judged]:
        self.seq += 1
        return self.session.ingest(Event(StreamKey(topic, "topic"), "m", self.seq, time, time, data))


def texts(judged: list[Judged]) -> dict[str, str]:
    """What is said of each violation."""
    found = [v for j in judged for v in j.verdicts if v.explanation is not None]
    return {v.property: v.explanation.text or "" for v in found if v.explanation is not None}


def test_a_violation_says_what_its_signals_were_computed_of() -> None:
    robot = Robot()
    robot("/limit", 0, v=1)
    for n in range(15):
        robot("/scan", SECOND + n, n=5)
    assert texts(robot("/cmd", SECOND + 20, v=1.5))["slow"].endswith(
        "; margin -0.5: limit - speed, limit = 1, speed = 1.5"
    )
    assert texts(robot("/scan", SECOND + 30, n=0.5))["far"].endswith(
        "; nearest 0.5: the least of near in 3 samples, last at step 18"
    )
    (alive, rate) = robot.session.advance(2 * SECOND + 1)
    assert texts([alive])["alive"].endswith("; scan_age 0.500000001: {topic: /scan} last at step 18")
    assert (rate.step.stamp, texts([rate])["scans"].split("; ")[-1]) == (
        2 * SECOND,
        "scan_rate 8.0: 16 of {topic: /scan} in 2s, last at step 18",
    )
    assert "scan_rate" not in rate.step.signals, "derived signals are never stored"


def test_there_is_no_deadline_before_enough_has_left() -> None:
    robot = Robot()
    for n in range(400):
        robot("/scan", n * SECOND // 100, n=5)
    assert robot.session.next_deadline == 399 * SECOND // 100 + SECOND // 2 + 1 + 1, "the age's, with a tick's wait"
    robot.session.judges["arrival"].tick(399 * SECOND // 100 + SECOND // 2 + 1, 0)
    # 19 of 200 are left when the one that is 20th from the end has left
    assert robot.session.next_deadline == (400 - 20) * SECOND // 100 + 2 * SECOND + 1


def test_a_robot_that_never_speaks_is_missed() -> None:
    robot = Robot()
    ticks = robot.session.advance(3 * SECOND)
    assert [(j.step.stamp, j.verdicts[1].outcome.value, j.verdicts[2].outcome.value) for j in ticks] == [
        (SECOND // 2 + 1, "unknown", "currently_false"),
        (2 * SECOND, "currently_false", "currently_false"),
    ]


def test_what_has_no_room_is_the_properties_complaint(monkeypatch: pytest.MonkeyPatch) -> None:
    room(monkeypatch, 2)
    robot = Robot()
    for n in range(4):
        robot("/scan", n, n=5)
    states = {state.property.id: state for state in robot.session.judges["arrival"].properties}
    assert "the windows of the session have more than" in (states["scans"].complaint or "")
    assert states["slow"].complaint is None


def test_whether_a_signal_is_there_is_not_known_where_it_has_failed() -> None:
    one, none = One("'has(k) ? x : 0 - x'"), frozenset[str]()
    assert [one(0, {"x": 1, "k": "u"}), one(0, {"x": 1}), one(0, {"k": "u"})] == [1, -1, None]
    assert [one(0, {"x": 1}, frozenset({"k"})), one(0, {"k": "u"}, frozenset({"x"}))] == ["failed", "failed"]
    two = One("has(k) || x > 1")
    assert [two(0, {"x": x}, failed) for x in (1, 2) for failed in (none, frozenset({"k"}))] == [
        False, "failed", True, True,
    ]  # fmt: skip


def test_long_texts_are_no_samples_where_many_are_kept() -> None:
    keyed_one, one = One("{last: x, by: k}"), One("{last: x}")
    long = "x" * 5_000
    assert keyed_one(1, {"x": long, "k": 1}) == "failed"
    assert keyed_one(2, {"x": long[:4_000], "k": 1}) == long[:4_000]
    assert keyed_one(3, {"x": "y", "k": 2}) == "y"
    assert one(1, {"x": long, "k": 1}) == long


def test_long_texts_are_keys_that_are_told_apart_and_not_kept() -> None:
    one, long = One("{last: x, by: k}"), "x" * 50_000
    for number in range(20):
        one(number, {"x": number, "k": f"{long}{number}"})
    assert one(21, {"k": f"{long}7"}) == 7
    assert one(22, {"k": long}) is None
    assert len(one.saved()) < len(long)


@pytest.mark.parametrize(
    ("derived", "asked"),
    [
        ("{count: '{topic: /x}', over: 100s, by: k}", "{d: 1}"),
        ("{sum: x, over: 100s, by: k}", "{d: 1}"),
        ("{age: '{topic: /x}', by: k}", "{d < 50}"),
        ("{last: x, by: k}", "{d: 1}"),
        ("{start: off, by: k, states: {off: {come: on}, on: {come: on}}}", "{d: on}"),
        ("{start: off, by: [k, l], states: {off: {come: on}, on: {come: on}}}", "{d: on}"),
    ],
)
def test_a_deadline_at_which_the_key_has_failed_tells_nothing(derived: str, asked: str) -> None:
    text = f"""
id: t
ordering: {{by: arrival}}
streams:
  - {{topic: /k, signals: {{k: msg.k}}, hold: [k]}}
  - {{topic: /l, signals: {{l: msg.l}}, hold: [l]}}
  - {{topic: /x, signals: {{x: msg.x}}}}
define: {{come: '{{topic: /x}}'}}
derive: {{d: {derived}}}
properties: [{{id: p, formula: '{asked} or once[:2s] {{topic: /x}}', time: seconds}}]
"""
    ready = plan(parse_spec(text, "t").spec)
    lasts: tuple[dict[str, Any], ...] = ({"k": "u"}, {"k": {}})
    for last in lasts:
        session = Session(ready, make_engines(ready), begun=0)
        session.attach("m", ready.spec.by_key, 0)
        rows: list[Judged] = []
        told: list[dict[str, Any]] = [{"l": "v"}, {"k": "u"}, {"x": 1}, last]
        for n, data in enumerate(told, 1):
            stream = StreamKey(f"/{next(iter(data))}", "topic")
            rows += session.ingest(Event(stream, "m", n, n * SECOND, n * SECOND, data))
        rows += session.advance(60 * SECOND)
        held = ["currently_true"] if last == {"k": "u"} else ["unknown"]
        assert [row.verdicts[0].outcome.value for row in rows[2:4]] == ["currently_true", *held]
        assert [row for row in rows[4:] if row.step.stamp < 50 * SECOND] == []
