"""The values that explanations name are those that the steps had, and what they call absent was absent."""

from __future__ import annotations

import json
import os
import random
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import pytest

from oracle_server.core.explanation import Reason, Why
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.naming import moment
from oracle_server.core.past import Past, Seen
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.brute import TimedSignals
from tests.engines.test_against_brute import SEED, matches
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "300"))
_VALUE = r'("[^"]*"|true|false|-?\d[\d.]*)'
_PLACE = r"(?:step (\d+)|the deadline) \(([^)]+)\)"
_SAID = re.compile(rf"(?:\b([{generate.KEYS}]) = {_VALUE}|`(\w+)` (is absent|could not be computed))")


def told(steps: Sequence[TimedSignals], lost: Sequence[frozenset[str]], *, tick: bool = False) -> Past:
    """The steps as a session remembers them; the last one is a deadline with `tick`."""

    def seen(place: int) -> Seen:
        at, signals = steps[place]
        if tick and place == len(steps) - 1:
            return Seen(None, at, "", signals, lost[place])
        return Seen(place + 1, at, f"/in (topic {place} of m)", signals, lost[place])

    return Past([at for at, _ in steps], lambda _: (), 10**6, seen)


def every(reasons: Sequence[Reason]) -> Iterator[Reason]:
    for reason in reasons:
        yield reason
        yield from every(reason.parts)


def parts(text: str) -> Iterator[tuple[str, int]]:
    """What a text says of each step, and the step's number; each is named after its values, or just before them."""
    for piece in text.split("; "):
        places = [(m, m[1]) for m in re.finditer(_PLACE, piece)]
        if _SAID.search(piece):
            assert places, f"values without a step: {piece}"
            yield piece, int(places[-1][1])


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_every_value_that_is_told_is_the_one_at_that_step(time: Time) -> None:
    counts = {"value": 0, "is absent": 0, "could not be computed": 0, "failing": 0}
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"values {time} {number}")
        formula = generate.formula(rng, time, rng.randint(1, 4))
        engine, steps = NativeEngine(formula, time), generate.trace(rng, 8)
        lost = [frozenset(k for k in generate.KEYS if k not in s and rng.random() < 0.3) for _, s in steps]
        found = list(matches(formula, steps))
        for last, (at, match) in enumerate(found, start=1):
            engine.step(at, match)
            past = told(steps[:last], lost)
            past = Past(past.times, [m for _, m in found].__getitem__, past.effort, past.seen)
            why = engine.explain(past)
            for reason in every(why.reasons):
                shown = f"TEST_SEED={SEED} case {number}, {render(formula, time)}\n{steps[:last]}\n{reason}"
                for piece, named in parts(reason.text):
                    check(piece, steps[named - 1][1], lost[named - 1], counts, shown)
                check_failing(reason, steps, lost, last, counts, shown)
    assert all(counts.values()), counts


def check(piece: str, signals: Mapping[str, Scalar], lost: frozenset[str], counts: dict[str, int], shown: str) -> None:
    for key, value, missing, how in _SAID.findall(piece):
        if key:
            counts["value"] += 1
            assert key in signals, shown
            assert json.dumps(signals[key]) == json.dumps(json.loads(value)), shown
        else:
            counts[how] += 1
            assert missing not in signals, shown
            assert (missing in lost) is (how == "could not be computed"), shown


def check_failing(
    reason: Reason, steps: Sequence[TimedSignals], lost: Sequence[frozenset[str]], last: int, counts: dict[str, int],
    shown: str,
) -> None:  # fmt: skip
    step = last if reason.step is None else reason.step
    for each in reason.failing:
        counts["failing"] += 1
        signals = steps[step - 1][1]
        assert (each.value is None) is (each.signal not in signals), shown
        assert each.value == signals.get(each.signal), shown
        assert each.missing == (
            None if each.signal in signals else "failed" if each.signal in lost[step - 1] else "absent"
        )
        assert each.text in reason.text, shown


DAY = 1_732_147_200 * SECOND
TRACE: list[tuple[int, dict[str, Any]]] = [
    (DAY - SECOND, {"topic": "/scan"}),
    (DAY + SECOND, {"topic": "/goal", "g": 3}),
    (DAY + 2 * SECOND, {"topic": "/cmd", "cmd": 1.4, "on": True}),
]


def explained(time: Time, text: str, steps: Sequence[TimedSignals] = TRACE, *, tick: bool = False) -> Why:
    formula = parse_formula(text, time)
    engine = NativeEngine(formula, time)
    found = list(matches(formula, steps))
    for at, match in found:
        engine.step(at, match)
    lost = [frozenset({"percent"}) if "g" in signals else frozenset[str]() for _, signals in steps]
    past = told(steps, lost, tick=tick)
    return engine.explain(Past(past.times, [m for _, m in found].__getitem__, past.effort, past.seen))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('{topic: "/cmd"} and {cmd <= 1.0}', "{cmd <= 1.0}: cmd = 1.4, wanted <= 1.0, at step 3 (00:00:02.000Z)"),
        ("{percent >= 20}", "{percent >= 20}: `percent` is absent, at step 3 (00:00:02.000Z)"),
        (
            "not {cmd > 1, on}",
            "{cmd > 1, on}: holds at step 3 (00:00:02.000Z), with cmd = 1.4",
        ),
        ('{topic: "/x", v > 2}', '{topic: "/x", v > 2}: topic = "/cmd", wanted "/x", at step 3 (00:00:02.000Z)'),
        ("{on: false, cmd != 1.4}", "{on: false, cmd != 1.4}: on = true, wanted false, and cmd = 1.4, wanted != 1.4, "
         "at step 3 (00:00:02.000Z)"),
        (
            "historically[2:] {g}",
            "historically[2:] {g}: `g` is absent, at step 1 (2024-11-20 23:59:59.000Z)",
        ),
        (
            "pre {percent > 3}",
            "pre {percent > 3}: its operand did not hold at step 2 (00:00:01.000Z): `percent` could not be computed",
        ),
        (
            'once {topic: "/goal", g > 5}',
            'once {topic: "/goal", g > 5}: none in steps 1–3; the last near miss: g = 3, wanted > 5, '  # noqa: RUF001
            "at step 2 (00:00:01.000Z)",
        ),
        (
            'once[:1] {topic: "/scan"}',
            'once[:1] {topic: "/scan"}: none in steps 2–3; last at step 1 (2024-11-20 23:59:59.000Z)',  # noqa: RUF001
        ),
        (
            'once[2:2] {topic: "/goal"}',
            'once[2:2] {topic: "/goal"}: none in step 1; next at step 2 (00:00:01.000Z)',
        ),
        ('once[1:] {topic: "/cmd"}', 'once[1:] {topic: "/cmd"}: none in steps 1–2; it holds at this step'),  # noqa: RUF001
        (
            'once[:1] {topic: "/goal", g: "3"}',
            'once[:1] {topic: "/goal", g: "3"}: none in steps 2–3, nor ever before; the last near miss: '  # noqa: RUF001
            'g = 3, wanted "3", at step 2 (00:00:01.000Z)',
        ),
        (
            'not {topic: "/done"} since {topic: "/goal", g: "3"}',
            'not {topic: "/done"} since {topic: "/goal", g: "3"}: no {topic: "/goal", g: "3"} in steps 1–3; '  # noqa: RUF001
            'the last near miss: g = 3, wanted "3", at step 2 (00:00:01.000Z)',
        ),
        (
            'not pre once {topic: "/goal"}',
            'pre once {topic: "/goal"}: its operand held at step 2 (00:00:01.000Z); once {topic: "/goal"}: '
            "(at step 2 (00:00:01.000Z)) held at step 2 (00:00:01.000Z)",
        ),
        ('once[:1] {topic: "/x"}', 'once[:1] {topic: "/x"}: none in steps 2–3, nor ever before'),  # noqa: RUF001
    ],
)  # fmt: skip
def test_what_is_said_of_values(text: str, expected: str) -> None:
    assert explained("steps", text).text == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            'not (not {topic: "/done"} since[2:] {topic: "/goal"})',
            'not {topic: "/done"} since[2s:] {topic: "/goal"}: {topic: "/goal"} held at step 2 (00:00:01.000Z), '
            '/in (topic 1 of m), 2s ago, and no {topic: "/done"} since; its deadline of 2s ran out',
        ),
        (
            'not once[2:] {topic: "/goal", g > 1} or once {topic: "/done"}',
            'once[2s:] {topic: "/goal", g > 1}: held at step 2 (00:00:01.000Z), /in (topic 1 of m), '
            "2s ago, with g = 3; "
            'its deadline of 2s ran out; once {topic: "/done"}: none so far',
        ),
        (
            'once[:500ms] {topic: "/cmd"}',
            'once[:500ms] {topic: "/cmd"}: none in the last 500ms; last at step 3 (00:00:02.000Z), '
            "/in (topic 2 of m), 1s ago, more than 500ms",
        ),
    ],
)
def test_a_deadline_names_the_event_whose_it_was(text: str, expected: str) -> None:
    steps: list[TimedSignals] = [*TRACE, (DAY + 3 * SECOND, {})]
    assert explained("seconds", text, steps, tick=True).text == expected
    assert moment(DAY) == "00:00:00.000Z"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            'once[600ms:800ms] {topic: "/goal"}',
            'once[600ms:800ms] {topic: "/goal"}: none between 600ms and 800ms ago, nor ever before; '
            "next at step 2 (00:00:01.000Z), 500.0001ms ago, less than 600ms",
        ),
        (
            'once[200ms:500ms] {topic: "/goal"}',
            'once[200ms:500ms] {topic: "/goal"}: none between 200ms and 500ms ago; '
            "last at step 2 (00:00:01.000Z), 500.0001ms ago, more than 500ms",
        ),
        (
            'once[600ms:1s] ({topic: "/goal"})',
            'once[600ms:1s] {topic: "/goal"}: none between 600ms and 1s ago, nor ever before; '
            "next at step 2 (00:00:01.000Z), 500.0001ms ago, less than 600ms",
        ),
        (
            'once[1s:2s] {topic: "/scan"}',
            'once[1s:2s] {topic: "/scan"}: none between 1s and 2s ago; '
            "last at step 1 (2024-11-20 23:59:59.000Z), 2.5000001s ago, more than 2s",
        ),
    ],
)
def test_what_missed_a_window_is_told_with_its_age_to_the_nanosecond(text: str, expected: str) -> None:
    steps: list[TimedSignals] = [*TRACE[:2], (DAY + 1_500_000_100, {"topic": "/x"})]
    assert explained("seconds", text, steps).text == expected


def test_a_deadlines_age_is_beyond_its_bound_as_it_is_told() -> None:
    steps: list[TimedSignals] = [*TRACE, (DAY + 4 * SECOND + 1, {})]
    assert explained("seconds", 'once[:2s] {topic: "/cmd"}', steps, tick=True).text.endswith(
        "last at step 3 (00:00:02.000Z), /in (topic 2 of m), 2.000000001s ago, more than 2s"
    )


def test_what_robots_send_is_told_in_one_line_of_some_length() -> None:
    steps: list[TimedSignals] = [(DAY, {"v": "a\nb\u202e" + "x" * 10_000})]
    text = explained("steps", '{v: "ok"}', steps).text
    assert text.startswith('{v: "ok"}: v = "a\\nb\\u202exxx')
    assert text.isprintable()
    assert len(text) < 200


def test_the_formula_of_an_atom_is_what_its_failing_constraints_are_of() -> None:
    why = explained("steps", '{topic: "/cmd"} and {cmd <= 1.0}')
    (reason,) = why.reasons
    assert isinstance(parse_formula(reason.formula, "steps"), tree.Atom)
    data = why.data(lambda *_: None)["reasons"][0]
    assert data["failing"] == [{"signal": "cmd", "op": "<=", "wanted": 1.0, "value": 1.4}]
    absent = explained("steps", "{percent >= 20}").data(lambda *_: None)["reasons"][0]
    assert absent["failing"] == [{"signal": "percent", "op": ">=", "wanted": 20, "value": None, "missing": "absent"}]
