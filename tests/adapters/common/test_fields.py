"""Which fields are read, and 32-bit floats as decimals."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle_adapter.fields import grouped, shortest


def test_paths_are_grouped_by_their_first_name_and_the_whole_takes_in_its_parts() -> None:
    assert grouped(["a.b.c", "d", "a.e"]) == {"a": ["b.c", "e"], "d": None}
    assert grouped(["a", "a.b"]) == grouped(["a.b", "a"]) == {"a": None}


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_a_32_bit_float_is_told_by_no_shorter_decimal(value: float) -> None:
    told = shortest(value)
    assert single(told) == value
    digits = len(f"{told:.9e}".partition("e")[0].rstrip("0").replace(".", "").lstrip("-"))
    if digits > 6:
        assert single(float(f"{value:.{digits - 1}g}")) != value


@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_what_is_no_finite_float_stays(value: float) -> None:
    assert repr(shortest(value)) == repr(value)


def single(value: float) -> float:
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.inf
