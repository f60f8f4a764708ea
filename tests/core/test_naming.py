"""Times and values as people are told of them."""

from __future__ import annotations

import json
from datetime import UTC, datetime

import pytest
from hypothesis import given
from hypothesis import strategies as st

from oracle_server.core import naming
from oracle_server.core.errors import one_line
from oracle_server.core.naming import moment, step_name, value_text

STAMPS = st.integers(min_value=10**18, max_value=2**63)


@given(STAMPS)
def test_a_time_is_told_in_utc_with_its_milliseconds(stamp: int) -> None:
    known = datetime.fromtimestamp(stamp // 10**9, UTC)
    assert moment(stamp) == f"{known:%H:%M:%S}.{stamp // 10**6 % 1000:03}Z"


@given(STAMPS, STAMPS)
def test_a_time_of_another_day_has_its_date(stamp: int, beside: int) -> None:
    known, other = (datetime.fromtimestamp(each // 10**9, UTC).date() for each in (stamp, beside))
    assert moment(stamp, beside) == (moment(stamp) if known == other else f"{known} {moment(stamp)}")


def test_small_times_are_seconds() -> None:
    assert (moment(0), moment(12_500_000_000), moment(12_500_000_000, 0)) == ("0.000 s", "12.500 s", "12.500 s")
    assert moment(10**18 - 1) == "999999999.999 s"
    assert moment(10**18) == "01:46:40.000Z"
    assert moment(10_500_000_001, exact=True) == "10.500000001 s"
    assert moment(10_500_000_000, exact=True) == "10.500 s"
    assert moment(10**18 + 1_200, exact=True) == "01:46:40.000001200Z"
    assert step_name(7, 12_500_000_000) == "step 7 (12.500 s)"
    assert step_name(None, 12_500_000_000) == "12.500 s"


@given(st.text() | st.booleans() | st.integers(-(2**63), 2**64 - 1) | st.floats(allow_nan=False, allow_infinity=False))
def test_a_value_is_told_in_one_line_and_as_it_is_where_it_is_short(value: str | bool | float) -> None:
    text = value_text(value)
    assert text.isprintable()
    assert len(text) <= 81
    plain = isinstance(value, str) and not value.isprintable()
    assert text.endswith("…") or plain or json.loads(text) == value


def test_of_a_long_text_no_more_is_looked_at_than_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    looked_at: list[int] = []

    def noted(text: str) -> str:
        looked_at.append(len(text))
        return one_line(text)

    monkeypatch.setattr(naming, "one_line", noted)
    assert value_text("\u202e" * 10**6) == '"' + ("\\u202e" * 14)[:79] + "…"
    assert looked_at == [82]
