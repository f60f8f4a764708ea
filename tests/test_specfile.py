"""Spec files: what is sound is read, and whatever else is refused with its place."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import Finding, SpecError
from oracle_server.core.plan import plan
from oracle_server.core.spec import Spec
from oracle_server.specfile import SpecFile, load_spec, parse_spec

ROOT = Path(__file__).parents[1]
CORPUS = sorted((Path(__file__).parent / "corpus" / "specs").glob("*.yaml"))
SOUND = [
    *sorted((ROOT / "specs").glob("*.yaml")),
    *sorted((Path(__file__).parent / "vectors" / "specs").glob("*.yaml")),
    *sorted((Path(__file__).parent / "server" / "specs").glob("*.yaml")),
]
many = settings(
    max_examples=300,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


def findings(text: str) -> tuple[Finding, ...]:
    """What is wrong with a text."""
    with pytest.raises(SpecError) as refused:
        parse_spec(text, "x.yaml")
    return refused.value.findings


def check(text: str) -> SpecFile | None:
    """A text is either a spec that can be judged by, or refused with places that it has."""
    try:
        file = parse_spec(text, "x.yaml")
    except SpecError as error:
        assert error.findings
        for finding in error.findings:
            assert finding.file == "x.yaml"
            assert 1 <= finding.line <= len(re.split(r"\r\n|[\n\r\x85\u2028\u2029]", text)) + 1
            assert finding.column >= 1
            assert finding.message
            assert "\n" not in str(finding)
        assert str(error).splitlines() == [str(f) for f in error.findings]
        return None
    assert plan(file.spec).spec is file.spec
    return file


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_a_malformed_spec_is_refused_at_its_place(path: Path) -> None:
    expected = re.match(r"# expect: (\d+:\d+: .*)", path.read_text().splitlines()[0])
    assert expected
    with pytest.raises(SpecError) as refused:
        load_spec(path)
    assert str(refused.value).startswith(f"{path}:{expected[1]}")


@pytest.mark.parametrize("path", SOUND, ids=lambda path: path.stem)
def test_shipped_specs_are_sound(path: Path) -> None:
    assert load_spec(path).spec.id == path.stem


# What is read


def sound(text: str) -> Spec:
    return parse_spec(text, "x.yaml").spec


SMALL = """\
id: small
streams:
  - topic: /a
  - service: /s
properties:
  - id: p
    formula: 'not {topic: "/a", v: 7}'
"""


def test_what_is_left_out_has_its_default() -> None:
    spec = sound(SMALL)
    ordering, (topic, request, response), (prop,) = spec.ordering, spec.streams, spec.properties
    assert (ordering.by, ordering.late, ordering.capacity) == ("publication", "judge", 10_000)
    assert (ordering.max_delay, ordering.max_skew) == (200 * 10**6, 10**9)
    assert (topic.name, topic.kind, topic.action, topic.ordered) == ("/a", "topic", "log", True)
    assert (topic.latency, topic.stamp, topic.signals, topic.hold) == (20 * 10**6, None, None, frozenset())
    assert (topic.intercept, topic.decide_within, topic.on_deny) == ("publisher", 2 * 10**9, "keep")
    assert [(s.name, s.kind, s.proxy) for s in (request, response)] == [
        ("/s", "request", "/s_mon"),
        ("/s", "response", "/s_mon"),
    ]
    assert request.on_unavailable == "deny"
    assert (prop.time, prop.blame, prop.latch, prop.engine, prop.guards) == ("steps", "any", False, "auto", frozenset())


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [
        ("20ms", 20 * 10**6),
        ("1.5s", 1_500_000_000),
        ("2s", 2 * 10**9),
        ("1ns", 1),
        ("0.001us", 1),
        ("0s", 0),
        ("3min", 180 * 10**9),
        ("1h", 3600 * 10**9),
        ("none", None),
    ],
)
def test_durations(text: str, nanoseconds: int | None) -> None:
    assert sound(f"ordering: {{max_delay: {text}}}\n{SMALL}").ordering.max_delay == nanoseconds


@pytest.mark.parametrize(("text", "type_"), [("p/msg/T", "p/msg/T"), ("p.msg.T", "p/msg/T"), ("p/T", "p/T")])
def test_ros_types(text: str, type_: str) -> None:
    assert sound(SMALL.replace("topic: /a\n", f"topic: /a\n    type: {text}\n", 1)).streams[0].type == type_


def test_a_spec_means_the_same_however_it_is_written() -> None:
    for path in SOUND:
        text = path.read_text()
        digest = sound(text).digest
        value: dict[str, Any] = yaml.safe_load(text)
        assert sound(yaml.safe_dump(value)).digest == digest
        assert sound(yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=40)).digest == digest
        assert sound("# a comment\n" + text.replace("\n", "\r\n")).digest == digest
        assert sound(yaml.safe_dump(value | {"description": "another"})).digest == digest
        assert sound(yaml.safe_dump(value | {"ordering": {"capacity": 77}})).digest != digest


def test_everything_that_is_wrong_is_told_at_once() -> None:
    text = SMALL.replace("topic: /a\n", "topic: /a\n    ordered: 7\n    late: judge\n", 1) + "    latch: 1\n"
    assert {(f.line, f.message.split(":")[0]) for f in findings(text)} == {
        (4, "streams.0.ordered"),
        (5, "unknown key 'late'"),
        (10, "properties.0.latch"),
    }


def test_findings_come_in_the_order_of_the_file() -> None:
    text = "colour: red\n" + SMALL.replace("topic: /a\n", "topic: 7\n", 1) + "    latch: 1\n"
    places = [(f.line, f.column) for f in findings(text)]
    assert places == sorted(places)


# Places of formulas

TOKENS = ["{topic: ", '"/a"', "}", "and", "once", "[", "1", ":", "]", "{", "id", ":", "'b'", "}"]


@pytest.mark.parametrize("style", ["literal", "single", "double"])
@given(data=st.data())
@many
def test_a_formulas_error_is_told_where_it_stands(style: str, data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(TOKENS)))
    gaps = data.draw(st.lists(st.integers(1, 3), min_size=len(TOKENS) + 1, max_size=len(TOKENS) + 1))
    breaks = data.draw(st.sets(st.integers(0, len(TOKENS)))) if style == "literal" else set()
    indent = " " * data.draw(st.integers(5, 9))
    formula = ""
    for i, token in enumerate([*TOKENS, ""]):
        formula += "@" * (i == at) + token + ("\n" if i in breaks else " " * gaps[i])
    lines = [line.strip(" ") for line in formula.split("\n")]
    match style:
        case "literal":
            chomp = data.draw(st.sampled_from(["", "-", "+"]))
            blank = data.draw(st.integers(0, 2))
            body = "\n".join(indent + line if line else "" for line in lines)
            written = f"|{chomp}\n" + "\n" * blank + body
        case "single":
            written = "'" + lines[0].replace("'", "''") + "'"
        case _:
            written = '"' + lines[0].replace('"', '\\"') + '"'
    text = SMALL[: SMALL.index("'not {topic")] + written + "\n    guards: []\n"
    row = next(i for i, line in enumerate(text.split("\n"), start=1) if "@" in line)
    column = text.split("\n")[row - 1].index("@") + 1
    assert [(f.line, f.column) for f in findings(text)] == [(row, column)], text


# Nothing but SpecError


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


YAMLISH = st.text(
    alphabet=st.sampled_from(list("ab:-?&*!|>'\"%@`#,[]{}~ \n\t\\0.1<=eE_/\ufeff\x85\u2028é")), max_size=120
)


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


FORMULA = st.lists(
    st.sampled_from(
        [
            "(",
            ")",
            "{",
            "}",
            "[",
            "]",
            ",",
            ":",
            ".",
            "*",
            "->",
            "not",
            "and",
            "or",
            "once",
            "historically",
            "since",
            "pre",
            "exists",
            "forall",
            "[1:]",
            "[:2]",
            "[:99999999]",
            "i",
            "s",
            "true",
            "7",
            "-1",
            "1e9",
            "inf",
            "{v:7}",
            "{v:*i}",
            '{topic:"/a"}',
            "exists[i].",
            "forall[i,s].",
            '"x"',
            "'y'",
            "<",
            ">=",
            "!=",
            "==",
            "==",
            "١",
            "²",
        ]
    ),
    max_size=25,
).map(" ".join)


@many
@given(FORMULA, st.sampled_from(["steps", "seconds"]))
def test_random_formulas_are_refused_or_read(formula: str, time: str) -> None:
    value = yaml.safe_load(SMALL)
    value["properties"][0] |= {"formula": formula, "time": time}
    check(yaml.safe_dump(value))


EXPRESSION = st.lists(
    st.sampled_from(
        [
            "msg",
            "msg.v",
            "msg.in",
            'msg["v"]',
            "msg['a']",
            ".",
            "(",
            ")",
            "[",
            "]",
            "{",
            "}",
            "?",
            ":",
            "+",
            "-",
            "*",
            "/",
            "%",
            "!",
            "&&",
            "||",
            "==",
            "<",
            "in",
            "1",
            "1u",
            "1.5",
            "1e999",
            "0x",
            "'a'",
            '"b"',
            "b'c'",
            "r'\\'",
            "string",
            "int",
            "double",
            "has",
            "size",
            "all",
            "exists",
            "map",
            "filter",
            "x",
            ",",
            "true",
            "null",
            "timestamp",
            "duration",
            "matches",
            "//",
        ]
    ),
    max_size=14,
).map(" ".join)


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


def test_a_file_that_is_too_long_or_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "long.yaml").write_text("# " + "x" * 3_000_000)
    (tmp_path / "folder.yaml").mkdir()
    (tmp_path / "latin.yaml").write_bytes(b"id: x\n# \xe4\n")
    for name, place in (
        ("long", "1:1: "),
        ("folder", "1:1: can't be read"),
        ("none", "1:1: can't be read"),
        ("latin", "2:1: "),
    ):
        with pytest.raises(SpecError) as refused:
            load_spec(tmp_path / f"{name}.yaml")
        (line,) = str(refused.value).splitlines()
        assert line.startswith(f"{tmp_path}/{name}.yaml:{place}")
