"""Spec files: what is sound is read, and whatever else is refused with its place."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from oracle_server.core.errors import Finding, SpecError
from oracle_server.core.spec import Spec
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import MOST, load_spec, parse_spec

ROOT = Path(__file__).parents[2]
STANDARD = Types(environment={})
WARNED = sorted((Path(__file__).parents[1] / "corpus" / "warned").glob("*.yaml"))
MISTAKEN = sorted((Path(__file__).parents[1] / "corpus" / "mistaken").glob("*.yaml"))
CORPUS = sorted((Path(__file__).parents[1] / "corpus" / "specs").glob("*.yaml"))
SOUND = [
    *sorted((ROOT / "specs").glob("*.yaml")),
    *sorted((Path(__file__).parents[1] / "vectors" / "specs").glob("*.yaml")),
    *sorted((Path(__file__).parents[1] / "whole" / "specs").glob("*.yaml")),
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


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_a_malformed_spec_is_refused_at_its_place(path: Path) -> None:
    expected = re.match(r"# expect: (\d+:\d+: .*)", path.read_text().splitlines()[0])
    assert expected
    with pytest.raises(SpecError) as refused:
        load_spec(path, types=STANDARD)
    first = next(finding for finding in refused.value.findings if finding.severity == "error")
    assert str(first).startswith(f"{path}:{expected[1]}")


@pytest.mark.parametrize("path", WARNED, ids=lambda path: path.stem)
def test_a_doubtful_spec_is_warned_of_at_its_place(path: Path) -> None:
    expected = re.match(r"# expect: (.*)", path.read_text().splitlines()[0])
    assert expected
    assert [str(warning) for warning in load_spec(path, types=STANDARD).warnings] == [f"{path}:{expected[1]}"]


@pytest.mark.parametrize("path", MISTAKEN, ids=lambda path: path.stem)
def test_a_mistake_is_told_in_these_words_and_nothing_beside_it(path: Path) -> None:
    expected = re.findall(r"^# expect: (.*)", path.read_text(), re.MULTILINE)
    assert expected
    found: tuple[Finding, ...] = ()
    try:
        found = load_spec(path, types=STANDARD).warnings
    except SpecError as refused:
        found = refused.findings
    assert [str(finding) for finding in found] == [f"{path}:{text}" for text in expected]
    assert not any(FORBIDDEN.search(text) for text in expected)


FORBIDDEN = re.compile(
    r"input should|valid (dict|list|bool|integer|string)|match pattern|\^\[|\$ |Error|mismatched|NUM_|LBRACE|token|"
    r"scanning|parsing|block (mapping|sequence)|flow |scalar|node content|None\b|True\b(?!\")|streams\.0|properties\.0"
)


@pytest.mark.parametrize("path", CORPUS, ids=lambda path: path.stem)
def test_a_refusal_has_no_words_of_a_library(path: Path) -> None:
    with pytest.raises(SpecError) as refused:
        load_spec(path, types=STANDARD)
    for finding in refused.value.findings:
        assert not FORBIDDEN.search(finding.message), finding.message


def test_all_errors_are_told_in_one_run() -> None:
    text = """\
id: x
streams:
  - {topic: /a, signals: {v: msg.v, w: msg.}}
  - {service: /s, response: {signals: {ok: "msg."}}, colour: red}
properties:
  - {id: p, formula: '{v: 1} =>', latch: yes}
  - {id: q, formula: '{v: 1'}
  - {id: r, formula: '{v > 1}', engine: natve}
"""
    assert [(f.line, f.column) for f in findings(text)] == [
        (3, 44), (4, 49), (4, 54), (6, 30), (6, 42), (7, 28), (8, 41),
    ]  # fmt: skip
    sound_keys = text.replace(", colour: red", "").replace(", latch: yes", "").replace(", engine: natve", "")
    assert [(f.line, f.column) for f in findings(sound_keys)] == [(3, 44), (4, 49), (6, 30), (7, 28)]


def test_what_stands_twice_is_told_with_the_place_of_the_first() -> None:
    (found,) = findings(SMALL + "  - {id: p, formula: '{v: 1}'}\n")
    assert found.message.endswith("the first is at x.yaml:6")
    (found,) = findings(SMALL.replace("  - service: /s", "  - topic: /a"))
    assert found.message.endswith("the first is at x.yaml:3")


def test_names_and_equals_signs_are_read_as_they_are_written_elsewhere() -> None:
    (prop,) = sound(SMALL.replace('topic: "/a", v: 7', "topic: /a, v = 7")).properties
    assert prop.formula == sound(SMALL).properties[0].formula


@pytest.mark.parametrize("path", SOUND, ids=lambda path: path.stem)
def test_shipped_specs_are_sound(path: Path) -> None:
    assert load_spec(path, types=STANDARD).spec.id == path.stem


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


@pytest.mark.parametrize(("text", "type_"), [("p/msg/T", "p/msg/T"), ("p.msg.T", "p/msg/T"), ("p/T", "p/msg/T")])
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
        (4, "stream '/a'"),
        (5, "stream '/a'"),
        (10, "property 'p'"),
    }


def test_findings_come_in_the_order_of_the_file() -> None:
    text = "colour: red\n" + SMALL.replace("topic: /a\n", "topic: 7\n", 1) + "    latch: 1\n"
    places = [(f.line, f.column) for f in findings(text)]
    assert places == sorted(places)


@pytest.mark.parametrize("mark", ["\\n", "\\e[31m"], ids=["newline", "escape"])
@pytest.mark.parametrize(
    "text",
    [
        SMALL + '"a%sb": 1\n',
        SMALL.replace("topic: /a", 'topic: "/a%sb"'),
        SMALL.replace("  - service: /s\n", '    signals: {"a%sb": ""}\n'),
        SMALL.replace('\'not {topic: "/a"', "\"not {topic: '/b%sb'").replace("}'", '}"'),
        SMALL.replace("'not {topic: \"/a\", v: 7}'", '"{v: 7} %s@"'),
    ],
    ids=["key", "topic", "signal", "atom", "formula"],
)
def test_a_finding_is_one_plain_line_whatever_it_quotes(text: str, mark: str) -> None:
    for finding in findings(text % mark):
        assert str(finding).isprintable()


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


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n", "\x85", "\u2028", "\u2029"])
@pytest.mark.parametrize(
    ("style", "place"), [("'{}'", (9, 19)), ('"{}"', (9, 19)), ("|\n      {}", (10, 11)), ("{}", (9, 18))]
)
def test_whatever_yaml_takes_for_the_end_of_a_line_counts_as_one(end: str, style: str, place: tuple[int, int]) -> None:
    head = f"# one{end}# two{end}# three{end}"
    text = "id: x\nstreams:\n  - topic: /a\nproperties:\n  - id: p\n    formula: " + style.format("not x{")
    (found,) = findings(head + text)
    assert (found.line, found.column) == place


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


def test_a_spec_of_too_many_streams_or_properties_is_refused_at_once() -> None:
    streams, properties = "  - topic: /a\n", "  - {id: p, formula: '{v: 1}'}\n"
    for key, many in (("streams", (18_000, 1)), ("properties", (1, MOST + 1))):
        text = f"id: x\nstreams:\n{streams * many[0]}properties:\n{properties * many[1]}"
        with pytest.raises(SpecError) as refused:
            parse_spec(text, "x.yaml")
        (finding,) = refused.value.findings
        assert finding.message == f"there are {max(many)} {key}; a spec has at most 1,000: write several specs"
        assert text.splitlines()[finding.line - 1] in (streams[:-1], properties[:-1])


def test_as_many_streams_and_properties_as_there_may_be_are_read() -> None:
    streams = "".join(f"  - topic: /a{n}\n" for n in range(MOST))
    properties = "".join(f"  - {{id: p{n}, formula: '{{v: {n}}}'}}\n" for n in range(MOST))
    one = "  - topic: /a0\n", "  - {id: p, formula: '{v: 1}'}\n"
    for several in ((streams, one[1]), (one[0], properties)):
        spec = parse_spec("id: x\nstreams:\n{}properties:\n{}".format(*several), "x.yaml").spec
        assert max(len(spec.streams), len(spec.properties)) == MOST
    with pytest.raises(SpecError, match="too many parts for 1000 streams"):
        parse_spec(f"id: x\nstreams:\n{streams}properties:\n{properties}", "x.yaml")


def test_a_session_of_an_older_version_may_have_a_spec_of_more_streams() -> None:
    streams = "".join(f"  - topic: /a{n}\n" for n in range(MOST + 1))
    text = f"id: x\nstreams:\n{streams}properties:\n  - {{id: p, formula: '{{v: 1}}'}}\n"
    assert len(parse_spec(text, "x", bounded=False).spec.streams) == MOST + 1


def test_comparisons_count_too_where_streams_are_many() -> None:
    streams = "".join(f"  - topic: /a{n}\n" for n in range(MOST))
    atom = "{" + ", ".join(f"v{n}: 1" for n in range(501)) + "}"
    with pytest.raises(SpecError, match="too many parts for 1000 streams"):
        parse_spec(f"id: x\nstreams:\n{streams}properties:\n  - {{id: p, formula: '{atom}'}}\n", "x.yaml")


def test_a_finding_names_the_first_of_many_streams_and_signals() -> None:
    streams = "".join(f"  - {{topic: /a{n}, signals: {{s{n}: msg.data}}}}\n" for n in range(MOST))
    typed = "".join(f"  - {{topic: /a{n}, type: std_msgs/msg/Bool}}\n" for n in range(MOST))
    untyped = "".join(f"  - topic: /a{n}\n" for n in range(MOST))
    properties = "properties:\n  - {id: p, formula: '{wrong: 1}'}\n"
    for several in (streams, typed):
        with pytest.raises(SpecError) as refused:
            parse_spec(f"id: x\nstreams:\n{several}{properties}", "x.yaml", types=STANDARD)
        (finding,) = refused.value.findings
        assert "/a0" in finding.message
        assert "988 more" in finding.message
        assert "/a13" not in finding.message
    (warning,) = parse_spec(f"id: x\nstreams:\n{untyped}{properties}", "x.yaml", types=STANDARD).warnings
    assert "/a0" in warning.message
    assert "988 more" in warning.message
    assert "/a13" not in warning.message


SHORT = "id: x\nstreams: [{topic: /a}]\nproperties: [{id: p, formula: '{v: 1}'}]\n"


def test_a_session_is_closed_after_a_time_and_means_the_same() -> None:
    spec = parse_spec(SHORT + "close: after 1.5h\n", "x.yaml").spec
    assert spec.close_after == 5400 * 10**9
    assert spec.digest == parse_spec(SHORT, "x.yaml").spec.digest
    assert parse_spec(SHORT, "x.yaml").spec.close_after is None


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ("1h", "such as `after 1h`, found '1h'; write after 1h"),
        ("after 1 h", "such as `after 1h`"),
        ("after 1d", "write 24h"),
        ("after 0s", "longer than 0s"),
        ("3600", "a time without a monitor such as `after 1h`"),
        ("{after: 1h}", "must be a time without a monitor, such as after 1h; found"),
        ("true", "must be a time without a monitor, such as after 1h; found true"),
    ],
)
def test_when_a_session_is_closed_is_written_in_one_way(value: str, reason: str) -> None:
    with pytest.raises(SpecError) as refused:
        parse_spec(f"{SHORT}close: {value}\n", "x.yaml")
    (finding,) = refused.value.findings
    assert (finding.line, finding.column) == (4, 8)
    assert reason in finding.message
