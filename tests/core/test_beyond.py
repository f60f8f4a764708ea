"""The values beyond bounds that are told of a step, against the formula table."""

from __future__ import annotations

from collections.abc import Mapping
from operator import ge, gt, le, lt

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st

from oracle_server.core.beyond import Beyond, looking
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.formula.tree import Formula, Scalar
from tests import strategies
from tests.brute import TimedSignals, truths

NUMBERS = st.sampled_from((0, 1, 2.5, -3, 7))
TRACE = st.lists(
    st.fixed_dictionaries({"a": NUMBERS, "c": NUMBERS}, optional={"b": st.one_of(NUMBERS, st.just("on"))}),
    min_size=1, max_size=6,
)  # fmt: skip
WRITTEN = st.recursive(
    st.sampled_from(
        ("{a <= 1}", "{b > 0}", "{c < a}", "{a: *}", "{b: on, a > 2}", "{a > 0, b >= 1}", "{c: 7}", "true")
    ),
    lambda inner: st.one_of(
        st.builds("not ({})".format, inner),
        st.builds("pre ({})".format, inner),
        st.builds("historically ({})".format, inner),
        st.builds("historically[:2] ({})".format, inner),
        st.builds("once[:2] ({})".format, inner),
        st.builds("once[1:] ({})".format, inner),
        st.builds("({}) {} ({})".format, inner, st.sampled_from(("and", "or", "->", "since")), inner),
        st.builds("(forall[x]. {{c: *x}} -> ({}))".format, inner),
        st.builds("(exists[y]. {{a: *y, c > 1}} and ({}))".format, inner),
    ),
    max_leaves=6,
)


def _told(formula: Formula, signals: Mapping[str, Scalar], *, fails: bool) -> tuple[Beyond, ...]:
    look = looking(formula, fails=fails)
    return () if look is None else look(signals) or ()


_COMPARED = {"<": lt, "<=": le, ">": gt, ">=": ge}


@settings(max_examples=400, deadline=None)
@given(written=WRITTEN, trace=TRACE)
def test_what_is_told_is_beyond_its_bound_where_the_formula_fails(written: str, trace: list[dict[str, Scalar]]) -> None:
    formula = parse_formula(written)
    holds = truths(formula, [*enumerate(trace)], "steps")[-1]
    seen = _told(formula, trace[-1], fails=False)
    found = _told(formula, trace[-1], fails=True)
    for value in (*seen, *found):
        bound = value.bound if value.than is None else trace[-1][value.than]
        assert bound == value.bound
        assert trace[-1][value.signal] == value.value
        assert not _COMPARED[value.op](value.value, value.bound)
    assert set(seen) <= set(found)
    if seen:
        event("seen")
        assert not holds, "it was not known to fail, and is told to"


@settings(max_examples=400, deadline=None)
@given(formula=strategies.formulas(depth=3), trace=strategies.traces(max_size=4))
def test_nothing_is_told_where_a_formula_holds(formula: Formula, trace: list[TimedSignals]) -> None:
    if trace and _told(formula, trace[-1][1], fails=False):
        event("seen")
        assert not truths(formula, trace, "steps")[-1]


@pytest.mark.parametrize(
    ("written", "told"),
    [
        ("{v <= 5}", ["v"]),
        ("{on} -> {v <= 5}", ["v"]),
        ("historically {v <= 5}", ["v"]),
        ("historically ({off} -> {v <= 5})", []),
        ("once[:2] {v <= 5}", ["v"]),
        ("{on} -> pre {v <= 5}", []),
        ("{v <= 5} or {w >= 3}", ["v", "w"]),
        ("{v <= 5} and {w <= 3}", ["v"]),
        ("not ({v > 5} or {w > 3})", ["v"]),
        ("forall[r]. {name: *r} -> {name: *r, v <= w}", ["v"]),
        ("forall[r]. {name: *r} and pre {v: *r} -> {v <= 5}", []),
    ],
)
def test_a_value_is_told_of_where_the_step_needs_it_within_its_bound(written: str, told: list[str]) -> None:
    signals: dict[str, Scalar] = {"on": True, "v": 9, "w": 1, "name": "r1"}
    assert [value.signal for value in _told(parse_formula(written), signals, fails=True)] == told
