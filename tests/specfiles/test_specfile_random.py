"""Spec files drawn at random: each is read, or refused with places that it has, and nothing else happens."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import SpecError
from oracle_server.core.plan import plan
from oracle_server.specfiles.load import SpecFile, load_spec, parse_spec
from tests.specfiles.test_specfile import SMALL, SOUND

many = settings(
    max_examples=300,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def check(text: str) -> SpecFile | None:
    """A text is either a spec that can be judged by, or refused with places that it has."""
    try:
        file = parse_spec(text, "x.yaml")
    except SpecError as error:
        refused = error
    else:
        assert plan(file.spec).spec is file.spec
        return file
    lines = len(re.split(r"\r\n|[\n\r\x85\u2028\u2029]", text))
    assert refused.findings
    for finding in refused.findings:
        assert finding.file == "x.yaml"
        assert 1 <= finding.line <= lines + 1
        assert finding.column >= 1
        assert finding.message
    return None


@many
@given(st.binary(max_size=400))
def test_random_bytes_are_refused(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "x.yaml"
    path.write_bytes(data)
    with pytest.raises(SpecError):
        load_spec(path)


@many
@given(st.text(max_size=300))
def test_random_text_is_refused(text: str) -> None:
    assert check(text) is None


MARKS = "ab:-?&*!|>'\"%@`#,[]{}~ \n\t\\0.1<=eE_/\ufeff\x85\u2028é"
YAMLISH = st.text(alphabet=st.sampled_from(list(MARKS)), max_size=120)


@many
@given(YAMLISH, st.integers(0, 10_000))
def test_random_marks_inside_a_spec_are_refused_or_read(marks: str, place: int) -> None:
    place %= len(SMALL)
    check(SMALL[:place] + marks + SMALL[place:])


@many
@given(st.sampled_from(SOUND), st.data())
def test_a_spec_with_a_piece_cut_out_or_doubled_is_refused_or_read(path: Path, data: st.DataObject) -> None:
    text = path.read_text()
    start = data.draw(st.integers(0, len(text)))
    end = data.draw(st.integers(start, min(len(text), start + 60)))
    check(text[:start] + text[end:])
    check(text[:end] + text[start:])


SCALARS = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**70), 2**70),
    st.floats(),
    st.text(max_size=12),
    st.sampled_from(
        ["/a", "/s", "p", "v", "topic", "none", "200ms", "1s", "filter", "undo", "msg.v", "msg", "[", "once"]
    ),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=10,
)


def parts(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all parts of a value."""
    inner: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        inner = list(value.items())
    elif isinstance(value, list):
        inner = list(enumerate(value))
    return [path, *(p for key, child in inner for p in parts(child, (*path, key)))]


@many
@given(st.sampled_from(SOUND), st.data())
def test_a_spec_with_another_value_in_it_is_refused_or_read(path: Path, data: st.DataObject) -> None:
    value = yaml.safe_load(path.read_text())
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from(parts(value)))
        assume(place)
        *outer, last = place
        holder = value
        for key in outer:
            holder = holder[key]
        holder[last] = data.draw(VALUES)
    check(yaml.safe_dump(value, allow_unicode=True))


RYE = """( ) { } [ ] , : . * -> not and or once historically since pre exists forall [1:] [:2] [:99999999] i s true 7 -1
 1e9 inf {v:7} {v:*i} {topic:"/a"} exists[i]. forall[i,s]. "x" 'y' < >= != == \u0661 \u00b2"""
FORMULA = st.lists(st.sampled_from(RYE.split()), max_size=25).map(" ".join)


@many
@given(FORMULA, st.sampled_from(["steps", "seconds"]))
def test_random_formulas_are_refused_or_read(formula: str, time: str) -> None:
    value = yaml.safe_load(SMALL)
    value["properties"][0] |= {"formula": formula, "time": time}
    check(yaml.safe_dump(value))


CEL = """msg msg.v msg.in msg["v"] msg['a'] . ( ) [ ] { } ? : + - * / % ! && || == < in 1 1u 1.5 1e999 0x 'a' "b" b'c'
 r'\\' string int double has size all exists map filter x , true null timestamp duration matches //"""
EXPRESSION = st.lists(st.sampled_from(CEL.split()), max_size=14).map(" ".join)


@many
@given(EXPRESSION)
def test_random_expressions_are_refused_or_read(expression: str) -> None:
    value = yaml.safe_load(SMALL)
    value["streams"][0]["signals"] = {"v": expression}
    file = check(yaml.safe_dump(value))
    if file is not None:
        project = plan(file.spec).streams[file.spec.streams[0].key].project
        values, failed = project({"v": 1, "a": [1], "in": "x"})
        assert set(values) | failed <= {"v"}


@pytest.mark.parametrize(
    "text",
    [
        "[" * 100_000,
        "{" * 100_000,
        "- " * 100_000,
        "? " * 100_000,
        "a: " * 50_000,
        "\n" * 250_000,
        "#" * 262_144,
        "a: &a [*a]",
        "x: " + "'" * 200_001,
        "id: " + "9" * 200_000,
        SMALL.replace("7}", "9" * 10_000 + "}"),
        SMALL.replace("not ", "not " * 3_000),
        SMALL.replace("not ", "(" * 4_000),
        SMALL.replace("not ", "exists[" + ",".join(f"a{i}" for i in range(2_000)) + "]. "),
        SMALL.replace("not ", "{v: 1} -> " * 1_500),
        SMALL.replace("not ", "{v: 1} since " * 1_000),
        SMALL + "  - id: x\n    formula: '{v: 1}'\n" * 4_000,
    ],
    ids=range(17),
)
def test_a_long_or_deep_text_is_refused_in_bounded_time(text: str) -> None:
    assert check(text) is None


@pytest.mark.parametrize(
    "expression",
    [
        "!" * 4_000 + "true",
        "-" * 4_000 + "1",
        "(" * 2_000 + "1" + ")" * 2_000,
        "[" * 2_000 + "]" * 2_000,
        "1" + "+1" * 2_000,
        "true" + "?true:true" * 400,
        "msg" + ".a" * 2_000,
        "msg" + "[0]" * 1_300,
        "msg.l" + ".map(x, x)" * 300,
        "has(" * 1_000 + "msg.a" + ")" * 1_000,
        "'" + "\\\\" * 2_000 + "'",
        "9" * 4_000,
        "1." + "9" * 4_000,
        "1" + " in [1]" * 500,
        "x" * 5_000,
    ],
    ids=range(15),
)
def test_a_long_or_deep_expression_is_refused_or_read(expression: str) -> None:
    value = yaml.safe_load(SMALL)
    value["streams"][0]["signals"] = {"v": expression}
    check(yaml.safe_dump(value))
