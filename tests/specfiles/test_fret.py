"""`import --fret`: requirements that are read, those that are not and stay unknown, and files of another shape."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from oracle_server.rostypes.known import Types
from oracle_server.specfiles.fret.read import FretError
from oracle_server.specfiles.fret.write import import_fret
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.lowered import lowered
from tests.whole.harness import failed, run

CORPUS = Path(__file__).parents[1] / "corpus" / "fret"
TIMINGS = (
    *("immediately", "at the next timepoint", "always", "never", "eventually", "within 3 ticks", "for 3 ticks"),
    *("after 3 ticks", "until s", "before s", ""),
)
CONDITIONS = ("", "when c ", "whenever c ")
SENTENCES = [
    f"{scope}{CONDITIONS[(i + j) % 3]}robot shall {timing} satisfy r"
    for i, scope in enumerate(("", "in m mode ", "except in m ", "before m ", "after m "))
    for j, timing in enumerate(TIMINGS)
    if timing not in ("finally", "eventually", "") or scope
]


def imported(folder: Path, *sentences: str, variables: str = "mcrsx") -> str:
    """The spec of sentences over some variables, each of a topic of its own."""
    requirements = [{"reqid": f"R-{i}", "fulltext": text} for i, text in enumerate(sentences)]
    inputs = [{"name": v, "connections": [{"scope": "ros/message", "topic": f"/{v}"}]} for v in variables]
    topics = [{"scope": "ros/message", "topic": f"/{v}", "type": "std_msgs::msg::Bool"} for v in variables]
    (folder / "reqs.json").write_text(json.dumps(requirements))
    (folder / "vars.json").write_text(json.dumps({"inputs": inputs, "topics": topics, "types": []}))
    import_fret(folder / "reqs.json", folder / "vars.json", folder / "spec.yaml", Types(()))
    return (folder / "spec.yaml").read_text()


def test_each_scope_condition_and_timing_is_what_the_same_requirement_written_here_is(tmp_path: Path) -> None:
    text = imported(tmp_path, *SENTENCES)
    defined = "".join(f"  {v}x: '{{{v}}}'\n" for v in "mcrs")
    by_hand = text.replace("streams:", f"define:\n{defined}streams:", 1)
    for v in "mcrs":
        by_hand = by_hand.replace(f" {{{v}}}", f" {v}x")
    assert "# TODO" not in text
    ours, theirs = (parse_spec(each, "spec.yaml").spec.properties for each in (text, by_hand))
    assert len(ours) == len(SENTENCES)
    assert list(lowered(ours)) == list(lowered(theirs))


@pytest.mark.parametrize(
    "sentence",
    [
        "only in m robot shall always satisfy r",
        "robot shall satisfy with probability > 0.9 r",
        "robot shall always satisfy c => r => s",
        "robot shall always satisfy x != 5",
        "robot shall always satisfy x + 1 > 5",
        "robot shall always satisfy x > 5 + 1",
        "robot shall always satisfy x > s",
        "robot shall always satisfy 1 < x < 5",
        "robot shall always satisfy 2 * x > 5",
        "robot shall always satisfy x > 5e3",
        "robot shall always satisfy x > 1.5.2",
        "robot shall always satisfy m /r",
        "robot shall always satisfy {r}",
        "robot shall always satisfy r(x)",
        "robot shall always satisfy if c r",
        "robot shall always satisfy if c => m then r => s",
        "when x > 5 + 1 robot shall always satisfy r",
        "robot shall always satisfy m => c <=> r",
        "robot shall always satisfy persisted(3, r)",
        "robot shall after 3 seconds satisfy r",
        "robot shall always satisfy nowhere",
        "robot shall always satisfy r é",
        "",
    ],
)
def test_what_has_no_counterpart_is_a_stub_that_is_unknown(tmp_path: Path, sentence: str) -> None:
    text = imported(tmp_path, sentence)
    assert "requirement:" not in text
    assert "formula: '{todo}'" in text
    assert '"todo": todo()' in text
    parse_spec(text, "spec.yaml")


def test_a_comparison_with_a_number_is_an_atom(tmp_path: Path) -> None:
    text = imported(tmp_path, "the robot shall always satisfy !x>5 & x = -1.5 => x<=5.")
    assert '"the robot shall always satisfy !{x > 5} & {x: -1.5} => {x <= 5}."' in text


def test_a_number_may_stand_before_what_it_is_compared_with(tmp_path: Path) -> None:
    text = imported(tmp_path, "robot shall always satisfy -1.5 <= x & 5>x & 3 = s | !(0 < m) & r")
    assert '"robot shall always satisfy {x >= -1.5} & {x < 5} & {s: 3} | !({m > 0}) & {r}"' in text


CONSTANTS = [
    {"variable_name": "idle", "idType": "Internal", "assignment": "2.0"},
    {"variable_name": "low", "idType": "Internal", "assignment": " -5 "},
    {"variable_name": "at", "idType": "Internal", "assignment": "pre state"},
    {"variable_name": "one", "idType": "Internal", "assignment": "1", "component_name": "a"},
    {"variable_name": "one", "idType": "Internal", "assignment": "2", "component_name": "b"},
    {"variable_name": "given", "idType": "Input", "assignment": "1"},
    {"variable_name": "state", "idType": "Output", "assignment": ""},
]


@pytest.mark.parametrize(
    ("said", "taken"),
    [
        ("state = idle", "{state: 2.0}"),
        ("idle = state & low <= state", "{state: 2.0} & {state >= -5}"),
        ("state=idle | !(state > low)", "{state: 2.0} | !({state > -5})"),
        ("state = at", ""),  # they differ, or are none
        ("state = one", ""),
        ("state = given", ""),
        ("state = state", ""),
        ("idle = low", ""),
        ("idle", ""),
        ("state + idle = low", ""),
        ("state = idle + low", ""),
        ("low < state + idle", ""),
        ("state - 3 < state", ""),
        ("state -3 < state", ""),
        ("2 * 3 < state", ""),
    ],
)
def test_a_name_that_stands_for_a_number_is_that(said: str, taken: str, tmp_path: Path) -> None:
    """As states of a machine in FRET's own examples; elsewhere than in a comparison nothing is made of it."""
    reqs, out = tmp_path / "reqs.json", tmp_path / "spec.yaml"
    was = {"reqid": "R", "fulltext": f"robot shall always satisfy {said}"}
    reqs.write_text(json.dumps({"requirements": [was], "variables": CONSTANTS}))
    done = import_fret(reqs, None, out, Types(()))
    text = out.read_text()
    assert (f'requirement: "robot shall always satisfy {taken}"' in text) is bool(taken)
    assert ("formula: '{todo}'" in text) is (not taken)
    if taken:
        assert done.todos == ("state",)
        assert "# idle is 2.0" in text


def test_a_name_whose_topic_is_told_is_no_constant(tmp_path: Path) -> None:
    reqs, topics, out = (tmp_path / name for name in ("reqs.json", "vars.json", "spec.yaml"))
    was = {"reqid": "R", "fulltext": "robot shall always satisfy idle > 1"}
    reqs.write_text(json.dumps({"requirements": [was], "variables": CONSTANTS}))
    inputs = [{"name": "idle", "connections": [{"scope": "ros/message", "topic": "/idle"}]}]
    of_ros = [{"scope": "ros/message", "topic": "/idle", "type": "std_msgs::msg::Float64"}]
    topics.write_text(json.dumps({"inputs": inputs, "topics": of_ros, "types": []}))
    assert import_fret(reqs, topics, out, Types(())).todos == ()
    assert "{idle > 1}" in out.read_text()


def test_if_and_then_in_a_response_are_taken(tmp_path: Path) -> None:
    text = imported(tmp_path, "when m robot shall immediately satisfy if ! c then x > 5 | r")
    assert '"when {m} robot shall immediately satisfy if ! {c} then {x > 5} | {r}"' in text


def test_the_first_point_of_time_is_the_first_step(tmp_path: Path) -> None:
    text = imported(tmp_path, "the FTP shall always satisfy r", "the robot shall always satisfy (FTP | r)")
    assert "define:\n  FTP: first\n" in text
    assert "# TODO" not in text
    spec = parse_spec(text, "spec.yaml")
    assert not spec.warnings
    assert [each["formula"] for each in lowered(spec.spec.properties)] == ["{r}", "first or {r}"]
    assert "define:" not in imported(tmp_path, "the FTP shall always satisfy r")


@pytest.mark.parametrize("declared", [True, False])
def test_a_variable_that_is_called_as_the_first_point_of_time(tmp_path: Path, *, declared: bool) -> None:
    was = {"reqid": "R", "fulltext": "robot shall always satisfy FTP", "semantics": {"variables": ["FTP"]}}
    variables = [{"variable_name": "FTP"}] if declared else []
    (tmp_path / "r.json").write_text(json.dumps({"requirements": [was], "variables": variables}))
    done = import_fret(tmp_path / "r.json", None, tmp_path / "s.yaml", Types(()))
    assert done.todos == (("FTP",) if declared else ())
    assert ("  FTP: first" in (tmp_path / "s.yaml").read_text()) is not declared


def test_names_that_yaml_reads_otherwise_or_that_are_taken(tmp_path: Path) -> None:
    requirements = [
        {"reqid": n, "fulltext": f"robot shall always satisfy {n}"} for n in ("on", "kind", "until", "null")
    ]
    variables = [{"variable_name": each["reqid"]} for each in requirements]
    (tmp_path / "r.json").write_text(json.dumps({"requirements": requirements, "variables": variables}))
    done = import_fret(tmp_path / "r.json", None, tmp_path / "s.yaml", Types(()))
    assert not done.refused
    assert not done.judges
    assert len(parse_spec((tmp_path / "s.yaml").read_text(), "s.yaml").spec.properties) == 4


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"\xff", "not UTF-8"),
        (b"[", ":1:2: not JSON"),
        (b"[" * 200_000, "not JSON"),
        (b"7", "no export of FRET"),
        (b"[7]", "requirements[0]"),
        (b'[{"reqid": 1}]', "`reqid`"),
        (b'[{"reqid": "a"}]', "`fulltext`"),
        (json.dumps([{"reqid": "a", "fulltext": ""}] * 1001).encode(), "1,001 requirements"),
        (b" " * 20_000_001, "more than 20 MB"),
    ],
)
def test_a_file_of_another_shape_is_refused_in_a_line(tmp_path: Path, content: bytes, told: str) -> None:
    (tmp_path / "r.json").write_bytes(content)
    with pytest.raises(FretError) as raised:
        import_fret(tmp_path / "r.json", None, None, Types(()))
    assert told in str(raised.value)
    assert "\n" not in str(raised.value)


def test_texts_of_others_stay_in_their_comments(tmp_path: Path) -> None:
    was = [
        {
            "reqid": "a\nb: c\ud800",
            "fulltext": "x\n    guards: [/x]\ud800",
            "rationale": "y\u2028\x85guards: [/y]\ud800",
        }
    ]
    (tmp_path / "r.json").write_text(json.dumps(was))
    import_fret(tmp_path / "r.json", None, tmp_path / "s.yaml", Types(()))
    [found] = parse_spec((tmp_path / "s.yaml").read_text(), "s.yaml").spec.properties
    assert found.id == "a_b__c_"
    assert not found.guards


def test_the_command(tmp_path: Path) -> None:
    out = tmp_path / "dock.yaml"
    files = (CORPUS / "dock_requirements.json", "--variables", CORPUS / "dock_variables.json")
    done = run("import", "--fret", *files, "-o", out)
    assert "is not done: lifted, the formula of BAT-003, the formula of X" in done.stderr
    spec = parse_spec(out.read_text(), "dock.yaml").spec
    assert [prop.time for prop in spec.properties[:2]] == ["seconds", "steps"]


def test_the_command_wants_one_source() -> None:
    assert "one of these is wanted" in failed("import")


def test_equivalence_and_exclusive_or_are_imported(tmp_path: Path) -> None:
    text = imported(tmp_path, "when m xor c robot shall always satisfy r <=> x > 5")
    assert '"when {m} xor {c} robot shall always satisfy {r} <=> {x > 5}"' in text
    parse_spec(text, "spec.yaml")
