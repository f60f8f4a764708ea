"""Patterns and requirements in spec files: what they stand for, what is wrong with them, and their explanations."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.core.verdicts import record
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec
from oracle_server.specfiles.lowered import lowered

SPEC = """
id: s
define: {auto: '{mode: AUTO}', low: '{level < 20}', docking: '{docked}', at(r): '{robot: *r, docked}'}
streams:
  - {topic: /goal, signals: {goal: msg.id}}
  - {topic: /status, signals: {goal: msg.id}}
  - {topic: /mode, signals: {mode: msg.data}, hold: [mode]}
  - {topic: /level, signals: {level: msg.data}, hold: [level]}
  - {topic: /pose, signals: {robot: msg.robot, docked: msg.docked}}
  - {service: /led, request: {signals: {on: msg.data}}}
  - {ros_action: /dock, goal: {}, result: {}}
properties:
  - {id: used, formula: 'forall[r]. (at(r) and auto and low) -> docking'}
  - id: p
"""


def spec_of(line: str) -> str:
    return SPEC + f"    {line}\n"


def formula_of(line: str) -> tuple[str, str]:
    *_, found = lowered(parse_spec(spec_of(line), "s.yaml").spec.properties)
    return found["time"], found["formula"]


def refusal_of(line: str) -> str:
    """What is told of the last line, with its column."""
    with pytest.raises(SpecError) as refused:
        parse_spec(spec_of(line), "s.yaml")
    (finding,) = [f for f in refused.value.findings if f.severity == "error"]
    assert finding.line >= 14, finding
    return f"{finding.column}: {finding.message}"


@pytest.mark.parametrize(
    ("line", "time", "formula"),
    [
        ("pattern: '/goal Causes /status'", "steps", '{topic: "/goal"} -> eventually {topic: "/status"}'),
        ("pattern: '/goal REQUIRES /status'", "steps", '{topic: "/goal"} -> once {topic: "/status"}'),
        ("requirement: In auto, When low The robot Shall Never Satisfy docking", "steps",
         '{mode: "AUTO"} since ({level < 20} and (not pre {level < 20} or {mode: "AUTO"} and not pre {mode: "AUTO"}) '
         'and {mode: "AUTO"}) -> not {docked}'),
        ("pattern: 'no /led {kind: request, on}'", "steps", 'not {service: "/led", kind: "request", on}'),
        ("pattern: '(/goal or /status {goal: 7}) forbids low'", "steps",
         '{level < 20} -> not once ({topic: "/goal"} or {topic: "/status", goal: 7})'),
        ("pattern: 'while at(r): no /goal'", "", ""),
        ("pattern: 'forall[r]. after at(r): no /goal {goal: *r}'", "steps",
         'forall[r]. not ({topic: "/goal", goal: *r} and once {robot: *r, docked})'),
        ("pattern: 'always low -> once[:2s] docking'\n    time: seconds", "seconds",
         "{level < 20} -> once[:2s] {docked}"),
        ("requirement: whenever low, the robot shall immediately satisfy docking.", "steps",
         "{level < 20} -> {docked}"),
        ("requirement: Where low the robot shall immediately satisfy docking", "steps",
         "{level < 20} and not pre {level < 20} -> {docked}"),
        ("requirement: if low & !auto then robot shall next satisfy docking", "steps",
         'pre ({level < 20} and not {mode: "AUTO"} and not pre ({level < 20} and not {mode: "AUTO"})) -> {docked}'),
        ("requirement: when in auto the robot shall always satisfy docking", "steps", '{mode: "AUTO"} -> {docked}'),
        ("requirement: robot shall always satisfy if low | auto then IF docking Then low => auto", "steps",
         '{level < 20} or {mode: "AUTO"} -> {docked} -> {level < 20} -> {mode: "AUTO"}'),
        ("requirement: robot shall always satisfy (if low => auto then docking) & !(if low then auto)", "steps",
         '(({level < 20} -> {mode: "AUTO"}) -> {docked}) and not ({level < 20} -> {mode: "AUTO"})'),
        ("requirement: if low, the robot shall, within 200 secs, satisfy docking", "seconds",
         "{level < 20} and not pre {level < 20} -> eventually[:200s] {docked}"),
        ("requirement: if (if low then auto), then the robot shall immediately satisfy docking", "steps",
         '({level < 20} -> {mode: "AUTO"}) and not pre ({level < 20} -> {mode: "AUTO"}) -> {docked}'),
    ],
)  # fmt: skip
def test_a_sentence_stands_for_a_formula(line: str, time: str, formula: str) -> None:
    if not formula:
        assert "the variable 'r' is free" in refusal_of(line)
        return
    assert formula_of(line) == (time, formula)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("pattern: '/goal cuses /status'",
         "21: pattern of 'p': behind an event stands `causes`, `requires`, `forbids`, `every 1s`, or `at least 10 Hz "
         "over 2s`, and not `cuses`; did you mean `causes`?; understood so far: `/goal`"),
        ("pattern: 'no /gaol'", "18: pattern of 'p': there is no stream /gaol; did you mean `/goal`?; understood so "
         "far: `no`"),
        ("pattern: 'afer /goal: no /status'", "15: pattern of 'p': a scope is `globally`, `after E`, `until E`, "
         "`after E until E` or `while φ`, and ends with `:`; `afer` is none; did you mean `after`?"),
        ("pattern: '/goal causes not low'", "28: pattern of 'p': an event is a stream, as `/cmd_vel` or `/cmd_vel "
         "{speed > 1}`, an atom, a name of `define:`, or what stands in parentheses, as `(… or …)` and `(not "
         "{armed})`; `not` is none"),
        ("pattern: |\n      after /goal:\n      no {x >}", "14: pattern of 'p': "),
        ("pattern: 'no /led'", "18: pattern of 'p': which event is meant? a service has requests and responses: write "
         "`/led {kind: request}`; understood so far: `no`"),
        ("pattern: '/goal causes /goal'", "21: pattern of 'p': both events are the same"),
        ("pattern: '/goal causes /status within 5 steps'\n    time: seconds",
         "43: pattern of 'p': this counts steps, and the property has `time: seconds`; leave `time` out"),
        ("pattern: '/goal causes (eventually low)'",
         "29: pattern of 'p': `eventually` waits for what comes; within a sentence stands what holds at a step"),
        ("pattern: 'no /goal'\n    engine: both", "13: property 'p': a pattern is judged by the project's own engine"),
        ("pattern: 'no /goal'\n    formula: low", "5: property 'p': what must hold is said by one of"),
        ("guards: []", "5: property 'p': the key 'formula' is missing, or `pattern`, `requirement` or `machine`"),
        ("pattern: after /goal: no /status", "14: not YAML: a pattern with `: ` in it must stand in quotes, as "
         "pattern: 'after /start: no /error'"),
        ("pattern: {no: x}", "14: property 'p': `pattern` must be a text in quotes"),
        ("pattern: 'always low within 5s'", "15: pattern of 'p': `always` has no `within`"),
        ("pattern: '/scan every 1s'", "15: pattern of 'p': there is no stream /scan"),
        ("pattern: '/goal every 5 steps'", "27: pattern of 'p': how often is a matter of time"),
        ("pattern: '/goal at least 10 Hz'", "35: pattern of 'p': over how long? write `over 2s`"),
        ("pattern: '/goal at least ten Hz over 2s'", "30: pattern of 'p': here stands a rate, as `10 Hz`"),
        ("pattern: 'at most 3 /goal'", "30: pattern of 'p': how often is a matter of time: write `within`"),
        ("pattern: 'at most three /goal within 2s'", "23: pattern of 'p': here stands how many"),
        ("pattern: '/goal every 2s'\n    time: steps", "15: pattern of 'p': this counts seconds"),
        ("pattern: '(once low) every 2s'", "21: derived signal 'p.age': `age` takes what holds at one step"),
        ("pattern: '/goal causes /status within 5s low'", "46: pattern of 'p': `low` is not expected here: `within`"),
        ("pattern: 'after /goal no /status'", "15: pattern of 'p': a scope ends with `:`"),
        ("pattern: 'no /goal low'", "24: pattern of 'p': `low` is not expected here: behind it"),
        ("pattern: 'at most 3 /goal low within 2s'", "31: pattern of 'p': `low` is not expected here: behind it"),
        ("pattern: '/goal every 0s'", "27: pattern of 'p': a time is longer than `0s` here"),
        ("pattern: 'never /goal'", "15: pattern of 'p': `never` is not understood: "),
        ("requirement: the robot shall witin 5 steps satisfy docking",
         "34: requirement of 'p': behind `shall` stands `satisfy`"),
        ("requirement: the robot shall satisfy low ∧ docking",
         "46: requirement of 'p': '∧' is no sign of a sentence; write `and`"),
        ("requirement: only in auto the robot shall satisfy docking",
         "18: requirement of 'p': `only` is not taken: it asks that the opposite holds elsewhere"),
        ("requirement: the robot shall finally satisfy docking", "34: requirement of 'p': `finally` is about the last"),
        ("requirement: when persisted(3, low) the robot shall satisfy docking",
         "23: requirement of 'p': `persisted` is not taken"),
        ("requirement: the robot shall satisfy speed > 5", "42: requirement of 'p': `speed` is compared in braces"),
        ("requirement: the robot shall after 5 seconds satisfy low", "34: requirement of 'p': `after` is taken with"),
        ("requirement: the robot shall satisfy dokcing", "42: requirement of 'p': there is no name `dokcing`"),
        ("requirement: the robot shall satisfy low within 5 steps", "46: requirement of 'p': `within` is not expected"),
        ("requirement: the robot shall satisfy if low docking", "49: requirement of 'p': behind `if` and what it asks "
         "stands `then`, and not `docking`"),
        ("requirement: the robot shall satisfy low => if auto then docking", "49: requirement of 'p': "
         "`if … then …` stands in parentheses here"),
        ("requirement: ''", "19: requirement of 'p': the requirement is empty"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_at_its_place(line: str, told: str) -> None:
    assert refusal_of(line).startswith(told)


def test_a_name_that_is_like_none_is_answered_with_what_was_understood() -> None:
    told = refusal_of("requirement: in auto, when low the robot shall within 30 seconds satisfy dockin")
    assert told.endswith(
        "; did you mean `docking`?; understood so far: `in auto, when low the robot shall within 30 seconds satisfy`"
    )


def test_what_is_said_in_other_words_is_another_spec() -> None:
    digests = {parse_spec(spec_of(f"pattern: 'no {e}'"), "s").spec.digest for e in ("/goal", "/status", "low")}
    assert len(digests) == 3


def test_warnings_are_told_at_the_sentence() -> None:
    line = "pattern: '/goal causes /status'"
    (warning,) = [f for f in parse_spec(spec_of(line), "s.yaml").warnings if f.line == 15]
    assert warning.column == 21
    assert "write one, as in `within 60s`" in warning.message


def test_a_violation_is_explained_by_the_sentence_first() -> None:
    lines = [
        "pattern: 'after /goal: no /status {goal: 7}'",
        "pattern: '/goal causes {level: *} within 1 steps'",
        "requirement: 'the robot shall never satisfy {goal: 7}'",
    ]
    for line in lines:
        key, sentence = line.split(": ", 1)
        ready = plan(parse_spec(spec_of(line).replace("id: s\n", "id: s\nordering: {by: arrival}\n"), "s").spec)
        session = Session(ready, make_engines(ready))
        found = []
        for n, topic in enumerate(["/goal", "/status"], 1):
            event = Event(StreamKey(topic, "topic"), "m", n, n * 10**9, n * 10**9, {"id": 7})
            found += [record(judged, v) for judged in session.ingest(event) for v in judged.verdicts]
        (told,) = {e["text"] for f in found if f["property"] == "p" and (e := f["explanation"])}
        assert f': "{sentence[1:-1]}": ' in told, key


@pytest.mark.parametrize(
    ("pattern", "formula", "derived"),
    [
        ("/goal {goal: *} every 500ms", '{"p.age" <= 0.5}', "age: '{topic: /goal, goal: *}'"),
        ("while auto: low at least 10 Hz over 2s", 'auto -> not {"p.rate" < 10}', "rate: low, over: 2s"),
        ("/goal at most 0.51Hz over 1min", '{"p.count" <= 30}', "count: '{topic: /goal}', over: 1min"),
        ("at most 3 (/goal or low) within 1s", '{"p.count" <= 3}', "count: '{topic: /goal} or low', over: 1s"),
    ],
)
def test_how_often_is_measured_as_by_a_derived_signal(pattern: str, formula: str, derived: str) -> None:
    name = formula.split('"')[1]
    written = f"formula: '{formula}'\n    time: seconds"
    by_hand = parse_spec(spec_of(written).replace("streams:", f"derive: {{{name}: {{{derived}}}}}\nstreams:"), "s").spec
    found = parse_spec(spec_of(f"pattern: '{pattern}'"), "s").spec
    assert found.properties[-1].formula == by_hand.properties[-1].formula
    assert found.properties[-1].time == "seconds"
    (ours,), (theirs,) = found.derive, by_hand.derive
    assert (ours.name, ours.op, ours.formula, ours.over) == (theirs.name, theirs.op, theirs.formula, theirs.over)


def test_too_many_are_too_many_from_the_first_message_on() -> None:
    text = spec_of("pattern: '/goal at most 2 Hz over 1500ms'").replace("id: s\n", "id: s\nordering: {by: arrival}\n")
    ready = plan(parse_spec(text, "s").spec)
    session = Session(ready, make_engines(ready))
    outcomes = []
    for n in range(1, 6):
        event = Event(StreamKey("/goal", "topic"), "m", n, n * 10**8, n * 10**8, {"id": 7})
        outcomes += [v.outcome.value for judged in session.ingest(event) for v in judged.verdicts if v.property == "p"]
    assert outcomes == ["currently_true"] * 3 + ["currently_false"] * 2


@pytest.mark.parametrize(
    ("duration", "bound"),
    [
        ("30s", "[:30s]"), ("30 s", "[:30s]"), ("2min", "[:120s]"), ("1h", "[:3600s]"), ("5us", "[:5us]"),
        ("1 second", "[:1s]"), ("30 Seconds", "[:30s]"), ("500 milliseconds", "[:500ms]"), ("2 minutes", "[:120s]"),
        ("1 hour", "[:3600s]"), ("3 microseconds", "[:3us]"), ("5 ticks", "[:5]"), ("5 m", "write `5min`"),
        ("5m", "`m` is no unit of time: write `5min`"), ("5 sec", "[:5s]"), ("200 secs", "[:200s]"),
        ("5 Millisecs", "[:5ms]"), ("5 MS", "write `5ms`"),
        ("5 millis", "write `5ms`"), ("5 days", "write `5s`, `5ms` or `5 steps`"), ("5", "a unit is missing"),
    ],
)  # fmt: skip
def test_a_duration_has_a_unit_that_is_no_other(duration: str, bound: str) -> None:
    line = f"pattern: '/goal causes /status within {duration}'"
    if bound.startswith("["):
        assert f"eventually{bound} " in formula_of(line)[1]
    else:
        assert bound in refusal_of(line)


@pytest.mark.parametrize(
    ("sentence", "outcomes"),
    [
        ("requirement: 'when {id: 1} the robot shall at the next timepoint satisfy fresh'", "now now now"),
        ("requirement: 'whenever {id: *} the robot shall immediately satisfy fresh'", "now now now"),
        ("requirement: 'when {id: 1} the robot shall until {id: 9} satisfy fresh'", "now now now"),
        ("pattern: 'no {idle > 2}'", "now now now"),
        ("pattern: '{id: *} requires {idle < 2} within 1s'", "now now now"),
        ("pattern: 'always {idle <= 2}'", "now now broken"),
        ("requirement: 'the robot shall always satisfy fresh'", "now now broken"),
        ("requirement: 'the robot shall never satisfy {idle > 2}'", "now now broken"),
    ],
)
def test_a_deadline_breaks_only_what_is_said_of_time(sentence: str, outcomes: str) -> None:
    """A latched guard would deny all that follows."""
    text = (
        "id: s\nordering: {by: arrival}\ndefine: {fresh: 'once[:2s] {topic: /a}'}\n"
        "streams:\n  - {topic: /a, signals: {}}\n  - {topic: /b, action: filter, signals: {id: msg.id}, hold: [id]}\n"
        "derive: {idle: {age: '{topic: /a}'}}\n"
        f"properties: [{{id: p, time: seconds, latch: true, guards: [/b], blame: any, {sentence}}}]\n"
    )
    ready = plan(parse_spec(text, "s").spec)
    session = Session(ready, make_engines(ready))
    judged = []
    for n, (topic, at) in enumerate((("/a", 1), ("/b", 2), ("/a", 5)), 1):
        judged += session.advance(at * 10**9 - 1)
        judged += session.ingest(Event(StreamKey(topic, "topic"), "m", n, at * 10**9, at * 10**9, {"id": 1}))
    words = {"currently_true": "now", "false": "broken"}
    told = [words[v.outcome.value] for j in judged for v in j.verdicts if j.step.event.stream.name in ("/a", "/b")]
    assert " ".join(told) == outcomes


def test_a_signal_that_a_pattern_makes_is_no_other() -> None:
    text = spec_of("pattern: '/goal every 2s'").replace("streams:", "derive: {p.age: {last: level}}\nstreams:")
    with pytest.raises(SpecError, match="its derived signal is called"):
        parse_spec(text, "s.yaml")


@pytest.mark.parametrize(
    "line",
    [
        "pattern: 'no " + "(" * 8_000 + "/goal" + ")" * 8_000 + "'",
        "pattern: 'no " + "(" * 8_000 + "'",
        "pattern: 'always " + "not " * 4_000 + "low'",
        "pattern: '" + "forall[x]. " * 1_400 + "no /goal {goal: *x}'",
        "pattern: 'no (" + "/goal or " * 1_700 + "/goal)'",
        "pattern: 'no /goal within " + "9" * 10_000 + "s'",
        "pattern: 'no /goal within " + "9" * 10_000 + "q'",
        "pattern: '" + "x" * 17_000 + "'",
        "requirement: the robot shall satisfy " + "(" * 8_000 + "low" + ")" * 8_000,
        "requirement: the robot shall satisfy " + "! " * 8_000 + "low",
        "requirement: the robot shall satisfy " + "low => " * 2_000 + "low",
        "requirement: the robot shall satisfy " + "low & " * 2_000 + "low",
        "requirement: the robot shall satisfy " + "if low then " * 1_000 + "low",
        "requirement: the robot shall satisfy " + "if " * 4_000 + "low",
    ],
    ids=range(14),
)
def test_what_is_too_large_is_refused_in_a_line(line: str) -> None:
    assert len(refusal_of(line)) < 1_000


@pytest.mark.parametrize(
    ("pattern", "time"),
    [
        ("no /goal within 5s", "5s"),
        ("no /goal {goal: *} within 2 minutes", "2 minutes"),
        ("no (/goal or /status) within 5 steps", "5 steps"),
        ("No /goal within 5s", "5s"),
        ("globally: no /goal within 5s", None),
        ("after low: no /goal within 5s", None),
        ("no /goal", None),
        ("some /goal within 5s", None),
    ],
)
def test_what_is_asked_of_the_beginning_alone_is_told_of(pattern: str, time: str | None) -> None:
    found = [each.message for each in parse_spec(spec_of(f"pattern: '{pattern}'"), "s.yaml").warnings]
    says = "pattern of 'p': it says nothing of what comes later than"
    assert [each.split(" after")[0] for each in found if says in each] == ([f"{says} {time}"] if time else [])


@pytest.mark.parametrize(
    ("response", "same"),
    [
        ("low <=> docking", "(low => docking) & (docking => low)"),
        ("low | auto <-> docking & auto", "(low | auto => docking & auto) & (docking & auto => low | auto)"),
        ("(low <=> docking) => auto", "((low => docking) & (docking => low)) => auto"),
        ("low xor docking", "low & !docking | !low & docking"),
        ("low XOR docking & auto", "low & !(docking & auto) | !low & (docking & auto)"),
        (
            "low xor docking xor auto",
            "(low & !docking | !low & docking) & !auto | !(low & !docking | !low & docking) & auto",
        ),
        ("low | docking xor auto => low", "((low | docking) & !auto | !(low | docking) & auto) => low"),
    ],
)
def test_equivalence_and_exclusive_or_are_what_they_stand_for(response: str, same: str) -> None:
    one, other = (formula_of(f"requirement: 'the robot shall always satisfy {each}'") for each in (response, same))
    assert one == other


@pytest.mark.parametrize("response", ["low <=> docking <=> auto", "low => docking <=> auto", "low <=> docking => auto"])
def test_how_an_equivalence_is_grouped_is_not_guessed(response: str) -> None:
    told = refusal_of(f"requirement: 'the robot shall always satisfy {response}'")
    assert "`<=>` is grouped with others is not said: put one of them in parentheses" in told
