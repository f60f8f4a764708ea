"""Relations between variables, as people write them: what holds, and what is said where it does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest

from oracle_server.core.errors import EngineError
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.past import Past
from oracle_server.core.spec import Property
from oracle_server.engines.native import NativeEngine
from oracle_server.engines.reelay import ReelayEngine
from oracle_server.engines.table import make_engine
from tests.brute import truths
from tests.engines.test_against_brute import holds, matches, outcomes

Steps = Sequence[Mapping[str, Scalar]]

NEVER_LESS = "forall[x, y]. {speed: *x} and pre {speed: *y} -> *y <= *x"
ABOVE_ALL = "forall[i, a, b]. {bid: *i, amount: *a} and pre once {bid: *i, amount: *b} -> *a > *b"
SOLD_FOR = "forall[i, p, m]. {sold: *i, price: *p} and once {offered: *i, least: *m} -> *p >= *m"
RESERVED = (
    "forall[i, r]. once {listed: *i, reserve: *r} and {sold: *i} -> "
    "exists[a]. once {bid: *i, amount: *a} and *a >= *r"
)  # fmt: skip
COMMANDS = (
    "forall[c]. (not {complete: *c} since {dispatch: *c}) and "
    '(*c == "MOVE" or *c == "DUMP") -> not {error}'
)  # fmt: skip
NUMBERED = "forall[m, c, d]. {command: *m, number: *c} and pre once {command: *m, number: *d} -> *c != *d"
WRITES = (
    "forall[f]. {write: *f} -> "
    'exists[m]. not {close: *f} since ({open: *f, mode: *m} and *m != "r")'
)  # fmt: skip
BETWEEN = "forall[x]. {level: *x} -> *x > 0 and *x <= 2.5 or *x == false"
TOO_HIGH = "exists[x, y]. {level: *x} and once {limit: *y} and *x > *y"
EVER = "forall[x, y]. not once ({a: *x, b: *y} and not *x < *y)"
KEPT = "forall[x, y]. {a: *x} and once {b: *y} -> ({a: *x} and once {b: *y} -> *x < *y) since[:2] {b: *y}"


@pytest.mark.parametrize(
    ("text", "steps", "expected"),
    [
        (NEVER_LESS, [{"speed": 1}, {"speed": 1.0}, {"speed": 3}, {"speed": 2}, {}, {"speed": 1}], "tttftt"),
        (ABOVE_ALL, [{"bid": "a", "amount": n} for n in (1, 3, 2, 4)], "ttft"),
        (ABOVE_ALL, [{"bid": i, "amount": n} for i, n in (("a", 2), ("b", 1), ("b", 1), ("a", "3"))], "ttff"),
        (SOLD_FOR, [{"offered": 1, "least": 5}, {"sold": 1, "price": 5}, {"sold": 1, "price": 4.5}], "ttf"),
        (
            RESERVED,
            [
                {"listed": "a", "reserve": 5},
                {"bid": "a", "amount": 4},
                {"sold": "a"},
                {"bid": "b", "amount": 6},
                {"sold": "a"},
                {"bid": "a", "amount": 5},
                {"sold": "a"},
                {"sold": "b"},
            ],
            "ttftfttt",
        ),
        (
            COMMANDS,
            [
                {"dispatch": "MOVE"},
                {"error": True},
                {"complete": "MOVE"},
                {"error": True},
                {"dispatch": "GO"},
                {"error": True},
            ],
            "tftttt",
        ),
        (NUMBERED, [{"command": "go", "number": n} for n in (1, 2, "1", True, 1.0)], "ttttf"),
        (WRITES, [{"open": 1, "mode": "r"}, {"write": 1}, {"open": 1, "mode": "w"}, {"write": 1}], "tftt"),
        (WRITES, [{"open": 1, "mode": "w"}, {"close": 1}, {"write": 1}], "ttf"),
        (BETWEEN, [{"level": v} for v in (1, 2.5, 0, "1", False, 0.0, 3, True)], "ttfftfff"),
        (TOO_HIGH, [{"level": 3}, {"limit": 2}, {"level": 2}, {"level": 2.5}, {"level": "a"}], "ffftf"),
        (EVER, [{"a": 1, "b": 2}, {"a": 1, "b": 1}, {}], "tff"),
        (KEPT, [{"b": 2}, {"a": 1}, {"a": 2}, {}, {"a": 1}], None),
        ('exists[x]. {a: *x} and *x == "A"', [{"a": "A"}, {"a": "B"}, {"b": "A"}], "tff"),
        ("exists[x]. {a: *x} and *x != true", [{"a": True}, {"a": 1}, {"a": "true"}, {}], "fttf"),
        ("exists[x, y]. {a: *x, b: *y} and *x == *y", [{"a": 1, "b": 1.0}, {"a": 1, "b": True}, {"a": 1}], "tff"),
    ],
)
def test_what_holds(text: str, steps: Steps, expected: str | None) -> None:
    formula, timed = parse_formula(text), list(enumerate(steps, start=1))
    found = [holds(outcome) for outcome in outcomes(NativeEngine(formula), formula, timed)]
    assert found == truths(formula, timed, "steps")
    assert expected is None or found == [mark == "t" for mark in expected]


def told(text: str, steps: Steps) -> str:
    formula, timed = parse_formula(text), list(enumerate(steps, start=1))
    engine, found = NativeEngine(formula), list(matches(formula, timed))
    for at, match in found:
        engine.step(at, match)
    return engine.explain(Past([at for at, _ in found], [match for _, match in found].__getitem__, effort=10**5)).text


def test_a_violation_is_told_with_the_values_that_were_compared() -> None:
    assert told(NEVER_LESS, [{"speed": 5}, {"speed": 3}]) == (
        "for x = 3, y = 5: {speed: 3}: holds at step 2; pre {speed: 5}: its operand held at step 1; "
        "5 <= 3: does not hold"
    )


def test_what_a_quantifier_within_says_is_told_of_the_values_around_it() -> None:
    steps: Steps = [{"listed": "a", "reserve": 5}, {"bid": "a", "amount": 4}, {"sold": "a"}]
    assert told(RESERVED, steps) == (
        'for i = "a", r = 5: once {listed: "a", reserve: 5}: held at step 1; {sold: "a"}: holds at step 3; '
        'exists[a]. once {bid: "a", amount: *a} and *a >= 5: for no value'
    )


def test_a_text_is_told_in_quotes() -> None:
    assert told('exists[x]. {a: *x} and *x != "B"', [{"a": "A"}]) == (
        'for x = "A": {a: "A"}: holds at step 1; "A" != "B": holds'
    )


def test_a_long_text_is_the_same_as_itself() -> None:
    long = "a" * 5_000
    formula = parse_formula(f'exists[x]. {{a: *x}} and *x == "{long}"')
    steps = [(1, {"a": long}), (2, {"a": long + "b"})]
    assert [holds(o) for o in outcomes(NativeEngine(formula), formula, steps)] == [True, False]


def test_a_trigger_may_compare() -> None:
    formula = parse_formula("forall[x]. {goal: *x} and *x > 3 -> eventually[:1] {done: *x}")
    steps: list[tuple[int, Mapping[str, Scalar]]] = [(1, {"goal": 3}), (2, {}), (3, {"goal": 4}), (4, {})]
    assert [holds(o) for o in outcomes(NativeEngine(formula), formula, steps)] == [True, True, True, False]


def test_reelay_refuses_them_and_beside_it_native_judges_alone() -> None:
    formula = parse_formula(NEVER_LESS)
    with pytest.raises(EngineError, match="compares the values of variables"):
        ReelayEngine(formula)
    assert isinstance(make_engine(Property("p", formula, engine="both")), NativeEngine)


def test_of_many_values_a_step_looks_at_those_that_it_has() -> None:
    formula = parse_formula(SOLD_FOR)
    engine = NativeEngine(formula)
    steps: list[tuple[int, Mapping[str, Scalar]]] = [(n, {"offered": n, "least": n}) for n in range(2_000)]
    steps += [(n, {"sold": n, "price": n}) for n in range(2_000)]
    for at, match in matches(formula, steps):
        engine.step(at, match)
        assert engine.work < 100
