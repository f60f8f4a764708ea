"""What each reason claims is what the formula table says, whatever is remembered: when a part held, by which steps.

    CASES=5000 pytest tests/engines/test_native_claims.py

is the long run. A case is told by its number alone.
"""

from __future__ import annotations

import math
import os
import random
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import pytest

from oracle_server.core.explanation import Reason
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Bound, Constraint, Formula, Ref
from oracle_server.core.past import Past, Seen
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.native.deciding import Deciding
from oracle_server.engines.native.parts import Part
from oracle_server.engines.native.wording import scalar
from tests import generate
from tests.brute import FRESH, TimedSignals, truths_for
from tests.engines.test_against_brute import SEED, matches
from tests.strategies import SECOND, START

CASES = int(os.environ.get("CASES", "40"))
_UNITS = {"s": SECOND, "ms": 10**6, "us": 10**3, "ns": 1}
_AMONG = re.compile(r"in steps? ([\d–, ]+?)(?: and \d+ more times up to (\d+))?(?=$|[,;]( [a-z]|$))")  # noqa: RUF001
_BETWEEN = re.compile(r"between (now|[\d.]+[mun]?s)(?: ago)? and (now|[\d.]+[mun]?s)(?: ago)?")
_EARLIER = re.compile(r"([\d.]+[mun]?s) ago or earlier")
_DECIDES: dict[type[Formula], bool] = {tree.Once: True, tree.Since: True, tree.Historically: False}
"""What an operand is at the step that decides these."""


def guarded(rng: random.Random, time: Time) -> Formula:
    """What people write most often: that something is so of each value that an event has."""
    body, past = generate.formula(rng, time, rng.randint(1, 3), 0, ("x",)), generate.bound(rng, time)
    body = rng.choice((body, tree.Historically(body, past), tree.Not(tree.Once(tree.Not(body), past))))
    return tree.Forall("x", tree.Implies(tree.Atom((Constraint("a", "==", Ref("x")),)), body))


def remembered(formula: Formula, steps: Sequence[TimedSignals], most: int, effort: int) -> Past:
    """The last steps, and no more than `most` of them."""
    first, found = max(0, len(steps) - most), list(matches(formula, steps))

    def seen(place: int) -> Seen:
        at, signals = steps[first + place]
        return Seen(first + place + 1, at, f"/in (topic {first + place + 1} of m)", signals, frozenset())

    return Past([at for at, _ in steps[first:]], lambda i: found[first + i][1], effort, seen)


class Claims:
    """Holds what is claimed at the last of some steps against the table."""

    def __init__(self, steps: Sequence[TimedSignals], time: Time) -> None:
        self._steps, self._time, self._last = steps, time, len(steps)
        self._at = [n if time == "steps" else at for n, (at, _) in enumerate(steps, 1)]
        self.seen = Counter[str]()

    def check(self, part: Part, at: Sequence[int], times: Sequence[int], found: Sequence[int], told: Reason) -> None:
        """One reason for a part at steps: by those `found` at `times`, or by a window of which its text tells."""
        formula = part.formula
        held = self._held(part, formula)
        decided, decides = _deciding(formula, holds=told.holds)
        by = found or [n for n in range(1, self._last + 1) if self._at[n - 1] in times]
        if decides is not None and times:
            witnesses = {n for n in by if self._held(part, decided)[n - 1] is decides}
            is_all = not found or {*found} == witnesses
            is_decided = is_all and all(self._is_witness(part, n, witnesses) for n in at)
            assert is_decided or self._plain(held, found, told), "they do not decide it"
        else:
            assert {held[n - 1] for n in found or at} == {told.holds}, "it was otherwise"
        if isinstance(formula, tree.Once | tree.Historically) and not times:
            self._window(part, formula, at, told.text.removeprefix(_prefix(told.text)))

    def _held(self, part: Part, formula: Formula) -> list[bool]:
        values = {name: scalar(part.values.get(i)) for name, i in part.scope.items()}
        return truths_for(formula, self._steps, self._time, {k: FRESH if v is None else v for k, v in values.items()})

    def _plain(self, held: Sequence[bool], by: Sequence[int], told: Reason) -> bool:
        """Whether the part itself is told of."""
        self.seen["plain"] += 1
        return len(by) > 0 and self._last not in by[:1] and all(held[n - 1] is told.holds for n in by)

    def _is_witness(self, part: Part, step: int, found: set[int]) -> bool:
        match part.formula:
            case tree.Pre():
                return step == 1 or step - 1 in found
            case tree.Since(left, _, bound):
                kept = self._held(part, left)
                return any(j in found and all(kept[j:step]) for j in self._within(bound, step))
            case tree.Once(_, bound) | tree.Historically(_, bound):
                return not found.isdisjoint(self._within(bound, step))
            case _:
                raise AssertionError(part.formula)

    def _within(self, bound: Bound, step: int) -> list[int]:
        upper, now = math.inf if bound.upper is None else bound.upper, self._at[step - 1]
        return [j for j in range(1, step + 1) if bound.lower <= now - self._at[j - 1] <= upper]

    def _window(self, part: Part, formula: tree.Once | tree.Historically, at: Sequence[int], text: str) -> None:
        """That a window is told as it is, and that there is no such step in it."""
        window = sorted({j for step in at for j in self._within(formula.bound, step)})
        held = self._held(part, formula.operand)
        if "before there were steps" in text:
            self.seen["nothing"] += 1
            assert all(self._at[step - 1] - formula.bound.lower < self._at[0] for step in at), "there were steps"
            return
        spots = self._spots(text)
        if spots is None or text.startswith("for "):
            return
        wanted = isinstance(formula, tree.Historically)
        if " their windows" in text or " its window" in text:
            self.seen["windows"] += 1
            assert {*window} <= {*spots}, f"{window} is not in {spots}"
            return
        self.seen["window"] += 1
        assert [n for n in spots if held[n - 1] is not wanted] == [], "there is one in it"
        assert spots == window, f"it is {window}"

    def _spots(self, text: str) -> list[int] | None:
        """The steps of which a text tells; None where it tells of none, or not of all."""
        text = text.split(";", maxsplit=1)[0].split(", nor ever", maxsplit=1)[0]
        told = _AMONG.search(text)
        if told:
            spans = [[int(n) for n in span.split("–")] for span in told[1].split(", ")]  # noqa: RUF001 -- a range
            return None if told[2] else [n for span in spans for n in range(span[0], span[-1] + 1)]
        between, earlier = _BETWEEN.search(text), _EARLIER.search(text)
        if earlier:
            return [n for n, at in enumerate(self._at, 1) if self._at[-1] - at >= _span(earlier[1])]
        if between:
            far, near = sorted((_span(between[1]), _span(between[2])), reverse=True)
            return [n for n, at in enumerate(self._at, 1) if near <= self._at[-1] - at <= far]
        return None


def _deciding(formula: Formula, *, holds: bool) -> tuple[Formula, bool | None]:
    """An operator's operand that decides it at a step, and whether it holds there; None where none does."""
    match formula:
        case tree.Pre(operand):
            return operand, holds
        case tree.Since(_, operand) | tree.Once(operand) | tree.Historically(operand):
            return operand, _DECIDES[type(formula)] if holds is not isinstance(formula, tree.Historically) else None
    return formula, None


def _prefix(text: str) -> str:
    """The steps at which a part is told of: `(at steps 3–4) `, with parentheses of times in it."""  # noqa: RUF002
    depth = 0
    for place, sign in enumerate(text if text.startswith("(") else ""):
        depth += {"(": 1, ")": -1}.get(sign, 0)
        if depth == 0:
            return text[: place + 2]
    return ""


def _span(text: str) -> int:
    found = re.fullmatch(r"(\d+)(?:\.(\d+))?([mun]?s)", text)
    if found is None:
        return 0  # now
    unit = _UNITS[found[3]]
    return int(found[1]) * unit + int((found[2] or "0").ljust(9, "0")) * unit // SECOND


Recorded = list[tuple[Part, Sequence[int], Sequence[int], Sequence[int], Reason]]


@pytest.fixture
def recorded(monkeypatch: pytest.MonkeyPatch) -> Recorded:
    """All reasons as they are made, with the parts and the steps that they are about."""
    made: Recorded = []
    reason = Deciding._reason

    def record(
        self: Deciding, part: Part, steps: Sequence[int], holds: bool, text: str,
        times: Sequence[int] = (), found: Sequence[int] = (), **more: Any,
    ) -> Reason:  # fmt: skip
        told = reason(self, part, steps, holds, text, times, found, **more)
        made.append((part, [*steps], [*times], [*found], told))
        return told

    monkeypatch.setattr(Deciding, "_reason", record)
    return made


def explained(
    formula: Formula, steps: Sequence[TimedSignals], time: Time, most: int, effort: int
) -> Iterator[tuple[int, str]]:
    """Each step's number, and why the formula stands as it does there."""
    engine = NativeEngine(formula, time)
    for last, (at, found) in enumerate(matches(formula, steps), 1):
        engine.step(at, found)
        yield last, engine.explain(remembered(formula, steps[:last], most, effort)).text


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_each_reason_is_as_the_table_says(time: Time, recorded: Recorded) -> None:
    seen = Counter[str]()
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"claims {time} {number}")
        formula = guarded(rng, time) if rng.random() < 0.5 else generate.either(rng, time, rng.randint(1, 4))
        steps, most, effort = generate.trace(rng, 9), rng.choice((1, 2, 4, 20)), rng.choice((100, 10**6))
        recorded.clear()
        for last, text in explained(formula, steps, time, most, effort):
            claims = Claims(steps[:last], time)
            for told in recorded:
                try:
                    claims.check(*told)
                except AssertionError as error:
                    shown = f"case {number}, {time}, step {last}, {most} remembered: {render(formula, time)}\n{text}"
                    raise AssertionError(f"{error}: {told[-1]}\n{shown}\n{steps[:last]}") from error
            recorded.clear()
            seen += claims.seen
    assert seen["window"] > 0


ROUND: list[TimedSignals] = [
    (START + n * SECOND, signals)
    for n, signals in enumerate(
        ({"b": 1}, {"b": 2}, {"a": 1}, {"b": 1}, {"b": 2}, {"b": 2}, {"a": 1}, {"b": 3}, {"a": 1, "b": 4})
    )
]
KEYED: list[TimedSignals] = [
    (START + n * SECOND, signals) for n, signals in enumerate(({"b": 5}, {"b": 7}, {"b": 5}, {}, {}, {}, {"a": 5}))
]


@pytest.mark.parametrize(
    ("time", "most", "text", "steps", "expected"),
    [
        ("steps", 20, "not once ({a: 1} and once[:1] {b: 1})", ROUND, "none in steps 2–3, 6–9"),  # noqa: RUF001
        (
            "seconds",
            20,
            "not once ({a: 1} and once[:1] {b: 1})",
            ROUND,
            "none in their windows, between 7s ago and now",
        ),
        ("steps", 2, "not pre once[4:6] {a: 3}", ROUND, "none in steps 2–4"),  # noqa: RUF001
        ("seconds", 2, "not pre once[4:6] {a: 3}", ROUND, "none between 7s ago and 5s ago"),
        ("seconds", 2, "not pre once[4:] {a: 3}", ROUND, "none 5s ago or earlier"),
        ("steps", 2, "not pre once {a: 3}", ROUND, "none in steps 1–8"),  # noqa: RUF001
        ("steps", 2, "not pre once[8:] {a: 3}", ROUND, "none before there were steps"),
        ("seconds", 20, "not pre once[500ms:800ms] {a: 3}", ROUND, "none between 1.8s ago and 1.5s ago"),
    ],
)
def test_a_window_is_told_as_it_is(
    time: Time, most: int, text: str, steps: list[TimedSignals], expected: str, recorded: Recorded
) -> None:
    *_, (_, said) = explained(parse_formula(text, time), steps, time, most, 10**6)
    assert any(told.text.endswith(expected) for *_, told in recorded), said


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_what_came_next_is_not_told_where_steps_after_the_window_are_forgotten(time: Time) -> None:
    formula = parse_formula("once[6:7] {a: 1}", time)
    found = {most: [*explained(formula, ROUND[:8], time, most, 10**6)][-1][1] for most in (20, 3)}
    assert "next at step 3" in found[20]
    assert "next" not in found[3], "step 7 is not the first one"


@pytest.mark.parametrize("time", ["steps", "seconds"])
@pytest.mark.parametrize(
    "body", ["historically {b: *x}", "not once not {b: *x}", "not ({c: 1} or not {a: 3} since not {b: *x})"]
)
def test_no_value_is_told_of_by_the_step_of_another(time: Time, body: str) -> None:
    """The engine does not tell the values of b apart any more: the first step fails for all of them but 5."""
    formula = parse_formula(f"forall[x]. {{a: *x}} -> {body}", time)
    for most in (1, 2, 3, 7):
        *_, (_, said) = explained(formula, KEYED, time, most, 10**6)
        assert "step 1" not in said, said
        assert "a step" not in said, said
