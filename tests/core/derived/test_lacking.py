"""Where a derived signal is said to be absent, it is at no event."""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.lacking import lacking
from oracle_server.core.formula.parse import parse_formula
from oracle_server.core.hazards.places import places
from oracle_server.core.spec import Property
from tests.core.derived.cases import Case, case, judged, parametric_case, rows_of


@settings(max_examples=400)
@given(st.integers(0, 2**32), st.sampled_from((case, parametric_case)))
def test_no_event_has_what_its_stream_lacks(seed: int, make: Callable[..., Case]) -> None:
    found = make(random.Random(seed), "steps")
    lacked = [(place.name, name) for place in places(found.spec, "steps") for name in place.lack]
    texts = [f'not {{topic: "{stream}", {name}: *}}' for stream, name in lacked] or ["true"]
    asked = tuple(Property(f"p{i}", parse_formula(text), text) for i, text in enumerate(texts))
    for row in rows_of(judged(replace(found, spec=replace(found.spec, properties=asked)))):
        assert "false" not in row[2]


def test_what_counts_from_an_event_begins_with_it() -> None:
    looked = 0
    for seed in range(150):
        found = case(random.Random(seed), "steps")
        texts = [
            f'{{topic: "{place.name}", {name}: *}} -> {{{name} {">= 1" if values.whole else "== 0"}}}'
            for place in places(found.spec, "steps")
            for name in place.counted
            if (values := place.now(name)) is not None
        ]
        asked = tuple(Property(f"p{i}", parse_formula(text), text) for i, text in enumerate(texts))
        for row in rows_of(judged(replace(found, spec=replace(found.spec, properties=asked)))) if asked else ():
            looked += 1
            assert "false" not in row[2], (seed, texts)
    assert looked > 100


@pytest.mark.parametrize(
    ("definitions", "has", "lacks"),
    [
        ([Definition("d", "sum", "x", by=("k",))], "x", {"d": ("k",)}),
        ([Definition("d", "sum", "x", by=("k",))], "k", {}),
        ([Definition("d", "sum", "x")], "", {}),
        ([Definition("d", "previous", "x")], "k", {"d": ("x",)}),
        ([Definition("d", "expression", "x - y")], "x", {"d": ("y",)}),
        ([Definition("d", "expression", "has(x) ? y : z")], "", {}),
        ([Definition("d", "expression", "x > 1 || y > 1")], "", {}),
        ([Definition("d", "last", "x", by=("k",)), Definition("e", "expression", "d + 1")], "x",
         {"d": ("k",), "e": ("k",)}),
        ([Definition("d", "last", "x", by=("k", "l"))], "l", {}),
        ([Definition("d", "last", "x", by=("k", "l"))], "x", {"d": ("k", "l")}),
    ],
)  # fmt: skip
def test_what_is_lacked(definitions: list[Definition], has: str, lacks: dict[str, tuple[str, ...]]) -> None:
    assert lacking(definitions, has.__contains__) == lacks
