"""What `check` says of scopes and conditions that are taken to last, and end with another stream's next message."""

from __future__ import annotations

import pytest

from oracle_server.core.events import Event, StreamKey
from oracle_server.core.plan import plan
from oracle_server.core.session import Session
from oracle_server.engines.table import make_engines
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: robot
streams:
  - {topic: /mode, signals: {mode: msg.mode, speed: msg.speed}, hold: HOLD}
  - {topic: /ready, signals: {ready: msg.data}, hold: [ready]}
  - {topic: /odom, signals: {v: msg.v}}
define:
  auto: '{mode: AUTO}'
properties:
  - {id: p, SENTENCE}
"""
BY_ITS_END = "requirement: 'in auto the robot shall within 2 seconds satisfy {ready}'"


def told(sentence: str, hold: str = "[]") -> list[str]:
    found = parse_spec(SPEC.replace("SENTENCE", sentence).replace("HOLD", hold), "s.yaml").warnings
    return [each.message for each in found if "is taken to last" in each.message]


@pytest.mark.parametrize(
    ("sentence", "verb"),
    [
        (BY_ITS_END, "is false"),
        ("requirement: 'after auto the robot shall never satisfy {ready}'", "is false"),
        ("requirement: 'when auto the robot shall within 2 seconds satisfy {ready}'", "is false"),
        ("requirement: 'except in auto the robot shall within 2 seconds satisfy {ready}'", "is false"),
        ("requirement: 'when !{mode: AUTO} the robot shall within 2 seconds satisfy {ready}'", "holds"),
        ("requirement: 'when {mode: AUTO, speed > 1} the robot shall for 2 seconds satisfy {ready}'", "is false"),
        ("pattern: 'while auto: at most 2 /odom within 2s'", "is false"),
    ],
)
def test_what_ends_with_another_streams_message_is_told_of(sentence: str, verb: str) -> None:
    (found,) = told(sentence)
    assert f"is taken to last, and {verb} at every event of /ready and /odom, whatever was said last: only /mo" in found
    assert " under `hold` of /mode" in found
    assert told(sentence, "[mode, speed]") == []


@pytest.mark.parametrize(
    "sentence",
    [
        "requirement: 'in auto the robot shall always satisfy {speed < 1}'",  # of one message
        "requirement: 'in auto the robot shall never satisfy {speed > 1}'",
        "pattern: 'while auto: no /mode {speed > 1}'",
        "requirement: 'when /mode {mode: AUTO} the robot shall within 2 seconds satisfy {ready}'",  # a coming is meant
        "requirement: 'whenever auto the robot shall within 2 seconds satisfy {ready}'",
        "requirement: 'before auto the robot shall never satisfy {ready}'",
        "requirement: 'when {ready} the robot shall within 2 seconds satisfy {v < 1}'",
        "pattern: 'after auto until /ready: no {v > 1}'",
    ],
)
def test_what_need_not_last_is_not(sentence: str) -> None:
    assert told(sentence) == []


def test_what_cannot_be_held_is_not_to_be() -> None:
    """An action's own signals are reserved, so that `hold` takes none of them."""
    action = "  - {ros_action: /nav, type: a_msgs/action/Nav, goal: {signals: {}}, result: {signals: {}}}\n"
    sentence = "requirement: 'in {status: succeeded} the robot shall within 2 seconds satisfy {ready}'"
    text = SPEC.replace("HOLD", "[]").replace("SENTENCE", sentence).replace("define:", f"{action}define:")
    (found,) = [each.message for each in parse_spec(text, "s.yaml").warnings if "is taken to last" in each.message]
    assert found.endswith(": `status` can't be held: keep what it tells by a machine under `derive`")


@pytest.mark.parametrize(("hold", "violations"), [("[]", 0), ("[mode]", 1)])
def test_the_mend_has_the_requirement_broken(hold: str, violations: int) -> None:
    """Without it the next message of any stream ends the scope, which excuses all that was asked within."""
    ready = plan(parse_spec(SPEC.replace("SENTENCE", BY_ITS_END).replace("HOLD", hold), "s.yaml").spec)
    session = Session(ready, [make_engines(ready)[0]], begun=0)
    second = 10**9
    for n, (topic, data) in enumerate([("/mode", {"mode": "AUTO"}), ("/odom", {"v": 1}), ("/odom", {"v": 1})], 1):
        session.ingest(Event(StreamKey(topic, "topic"), "m", n, n * second, n * second, data))
    session.finish(20 * second)
    (state,) = session.judges["publication"].told.properties
    assert state.violations == violations


def before(formula: str, hold: str = "[]") -> list[str]:
    found = parse_spec(SPEC.replace("SENTENCE", f"formula: '{formula}'").replace("HOLD", hold), "s.yaml").warnings
    return [each.message for each in found if "`pre` asks of the step before" in each.message]


@pytest.mark.parametrize(
    ("formula", "verb"),
    [
        ("not ({mode: AUTO} and pre {mode: FAULT})", "is false"),
        ("{mode: AUTO} and pre not {mode: AUTO} -> {speed < 1}", "holds"),
        ("forall[x, y]. {speed: *x} and pre {speed: *y} -> *x <= *y", "is false"),
    ],
)
def test_what_another_streams_message_hides_from_pre_is_told_of(formula: str, verb: str) -> None:
    (found,) = before(formula)
    assert f"{verb} at every event of /ready and /odom, whatever was said last; only /mode has `" in found
    assert found.endswith("under `hold` of /mode, so that it keeps its value")
    assert before(formula, "[mode, speed]") == []


@pytest.mark.parametrize(
    "formula",
    [
        "{topic: /mode} -> pre {topic: /odom}",
        "{ready} and not pre {ready} -> {v < 1}",
        "{mode: AUTO} -> pre once {mode: IDLE}",
        "{mode: AUTO} -> pre ({ready} or not {ready})",
    ],
)
def test_what_pre_asks_of_any_step_is_not(formula: str) -> None:
    assert before(formula) == []


def test_pre_of_a_streams_own_message_is_told_of_where_the_signal_is_held_too() -> None:
    (found,) = before("{topic: /mode, mode: AUTO} -> pre {topic: /mode, mode: IDLE}", "[mode]")
    assert found.endswith('whatever was said last; leave the stream out of `{topic: "/mode", mode: "IDLE"}`')


def after(formula: str, hold: str = "[]") -> list[str]:
    found = parse_spec(SPEC.replace("SENTENCE", f"formula: '{formula}'").replace("HOLD", hold), "s.yaml").warnings
    return [each.message for each in found if "`next` asks of the step after" in each.message]


@pytest.mark.parametrize(
    ("asked", "verb"), [("not {v > 3}", "holds"), ("{v: 0}", "is false"), ("{topic: /odom, v: 0}", "is false")]
)
def test_what_another_streams_message_hides_from_next_is_told_of_with_what_is_not(asked: str, verb: str) -> None:
    (found,) = after(f"{{ready}} -> next {asked}", "[mode]")
    assert (
        f"{verb} at every event of /mode and /ready, whatever is said later; to ask of the next one of /odom" in found
    )
    mend = found.rpartition("write `")[2].removesuffix("`")
    assert mend.startswith('next (not {topic: "/odom"} until ({topic: "/odom"} and ')
    assert after(f"{{ready}} -> {mend}") == []


def test_next_of_what_all_events_have_is_not() -> None:
    assert after("{topic: /odom, v: 1} -> next {mode: AUTO}", "[mode]") == []
