from __future__ import annotations

import array
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from oracle_adapter import dumps


class Numpyish:
    """As numpy's arrays and scalars are: something with `tolist`."""

    def __init__(self, value: Any) -> None:
        self.value = value

    def tolist(self) -> Any:
        return self.value


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "null"),
        (True, "true"),
        (2**63 - 1, "9223372036854775807"),
        (-(2**63), "-9223372036854775808"),
        (2**64 - 1, "18446744073709551615"),
        (0.1, "0.1"),
        (7.0, "7.0"),
        (float("nan"), '"NaN"'),
        (float("inf"), '"Infinity"'),
        (float("-inf"), '"-Infinity"'),
        (b"\x00\xff", '"AP8="'),
        (bytearray(b"ab"), '"YWI="'),
        (memoryview(b"ab"), '"YWI="'),
        ((1, 2), "[1,2]"),
        (array.array("i", [1, -2]), "[1,-2]"),
        (array.array("B", [1, 255]), "[1,255]"),
        (array.array("d", [1.5, float("nan")]), '[1.5,"NaN"]'),
        (Numpyish([[1], [2]]), "[[1],[2]]"),
        (Numpyish(3), "3"),
        (Numpyish([float("inf"), b"a"]), '["Infinity","YQ=="]'),
        ("ä", '"\\u00e4"'),
        ("😀", '"\\ud83d\\ude00"'),
        ("a\udcffb", '"a\\ufffdb"'),
        ({"a": (float("nan"), b"")}, '{"a":["NaN",""]}'),
    ],
)
def test_values(value: Any, text: str) -> None:
    assert dumps(value) == text


@pytest.mark.parametrize("value", [object(), {1, 2}, {"a": [object()]}, [float("nan"), object()]])
def test_what_is_no_message_value_is_refused(value: Any) -> None:
    with pytest.raises(TypeError):
        dumps(value)


values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(st.characters())
    | st.binary(),
    lambda inner: st.lists(inner) | st.tuples(inner, inner) | st.dictionaries(st.text(), inner),
    max_leaves=20,
)


@given(values)
def test_any_value_is_strict_json_that_utf8_can_carry(value: Any) -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    text = dumps(value)
    text.encode("ascii")
    read = json.loads(text, parse_constant=refuse)
    json.dumps(read, ensure_ascii=False).encode("utf-8")
    if isinstance(value, (int, str)) and "\ufffd" not in str(read):
        assert read == value
