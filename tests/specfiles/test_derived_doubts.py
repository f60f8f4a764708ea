"""What `check` warns of in derived signals: what their formulas never meet, and where they are absent."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.rostypes.known import Types
from oracle_server.specfiles.load import parse_spec

TYPES = Types([], {})
STREAMS = """\
id: t
streams:
  - {topic: /on, type: std_msgs/msg/Bool, signals: {on: msg.data}}
  - {topic: /n, type: std_msgs/msg/UInt8, signals: {n: msg.data}}
  - {topic: /mode, type: std_msgs/msg/String, signals: {mode: msg.data}, hold: [mode]}
  - {topic: /pay, signals: {user: msg.user, amount: msg.amount}}
  - {topic: /cmd, signals: {speed: msg.speed}}
"""
SOUND = "properties: [{id: ok, formula: '{topic: /n} -> once {topic: /on}'}]\n"


def told(text: str) -> list[str]:
    """The warnings, without the file's name."""
    found = [str(each).split("warning: ", 1)[1] for each in parse_spec(STREAMS + text, "s.yaml", types=TYPES).warnings]
    return [each for each in found if "no formula uses it" not in each]


def derived(of: str, events: str = "up: '{on}', down: '{on: false}'") -> list[str]:
    return told(f"define: {{{events}}}\nderive: {{m: {of}}}\n{SOUND}")


MACHINE = "{start: a, states: {a: {up: b}, b: {down: a}}}"


@pytest.mark.parametrize(
    ("of", "events", "says"),
    [
        (MACHINE, "up: '{on: \"yes\"}', down: '{on}'",
         "`on: \"yes\"` is never met: `on` of /on is always true or false"),
        ("{sequence: up down*}", "up: '{n: 300}', down: '{on}'", "`n: 300` is never met"),
        ("{count: '{n > 300}', over: 1s}", "up: '{on}'", "`n > 300` is never met"),
        ("{age: '{topic: /on} and {n > 3}'}", "up: '{on}'", "`{topic: \"/on\"} and {n > 3}` never holds, whatever the "
         "messages say: only /n has `n`; name it under `hold` of /n, so that it keeps its value"),
        ("{rate: '{n >= 0}', over: 1s}", "up: '{on}'", "`n >= 0` is met by every value"),
        ("{count: '{topic: /n} or not {topic: /n}', over: 1s}", "up: '{on}'",
         "`{topic: \"/n\"} or not {topic: \"/n\"}` holds at every event, whatever the messages say"),
        ("{follows: on, states: {'true': ['maybe'], 'maybe': ['true']}}", "up: '{on}'",
         "no value of `on` is the state 'maybe': it is always true or false"),
        ("{follows: n, states: {'1': ['2'], '2': ['300'], '300': ['1']}}", "up: '{on}'",
         "no value of `n` is the state '300': it is always a whole number from 0 to 255"),
        (MACHINE, "up: '{mode: AUTO}', down: '{on}'",
         '`{mode: "AUTO"}` holds at the messages of all streams, since `mode` of /mode is held, so that the event '
         'comes again at each of them; write `{topic: "/mode", mode: "AUTO"}` if it is one of /mode alone'),
        ("{start: a, states: {a: {up: b}, b: {}, error: {up: a, within: 3s}}}", "up: '{on}'",
         "`within` of 'error' is never told of: `machine: m` is violated as long as the machine is there"),
    ],
)  # fmt: skip
def test_what_hardly_was_meant_is_told(of: str, events: str, says: str) -> None:
    (found,) = derived(of, events)
    assert found.startswith(f"derived signal 'm': {says}")


@pytest.mark.parametrize(
    "of",
    [
        MACHINE,
        "{count: '{n > 3} or {on}', over: 1s}",
        "{count: '{mode: AUTO}', over: 1s}",
        "{age: '{topic: /mode, mode: AUTO}'}",
        "{follows: on, states: {'true': ['false'], 'false': ['true']}}",
        "{follows: mode, states: {A: [B], B: [A]}}",
        "{follows: n, states: {'1': ['2'], '2': ['1']}}",
        "{sequence: 'up (down | up)*'}",
    ],
)
def test_nothing_is_said_of_what_is_right(of: str) -> None:
    assert derived(of) == []


def test_a_pattern_is_told_of_at_its_place() -> None:
    text = STREAMS + "properties:\n  - {id: p, pattern: '/n {n > 256} every 2s'}\n"
    (found,) = parse_spec(text, "s.yaml", types=TYPES).warnings
    assert (found.line, found.column) == (9, 23)
    assert "`n > 256` is never met" in found.message


KEYED = "derive: {spent: {sum: amount, over: 1h, by: user}, twice: 2.0 * spent, gap: speed - n, d: {delta: speed}}\n"


@pytest.mark.parametrize(
    ("formula", "says"),
    [
        ("{topic: /cmd} -> {spent <= 5}", "`{spent <= 5}` never holds at an event of /cmd: `spent` needs `user`, and "
         "only /pay has `user`; name it under `hold` of /pay, so that it keeps its value"),
        ("not {topic: /cmd, twice > 5}", "`twice` needs `user`, and only /pay has `user`"),
        ("{topic: /cmd} -> not {gap < 0}", "`gap` needs `n`, and only /n has `n`"),
        ("{topic: /n} -> {d < 1}", "`d` needs `speed`, and only /cmd has `speed`"),
    ],
)  # fmt: skip
def test_a_derived_signal_is_asked_for_where_it_may_be(formula: str, says: str) -> None:
    (found,) = told(f"{KEYED}properties: [{{id: p, formula: '{formula}'}}]\n")
    assert says in found


def test_a_guard_that_asks_for_what_its_stream_lacks_denies_none() -> None:
    filtered = STREAMS.replace("msg.speed}", "msg.speed}, action: filter")
    text = f"{filtered}{KEYED}properties: [{{id: p, formula: 'not {{spent > 5}}', guards: [/cmd]}}]\n"
    (found,) = (each.message for each in parse_spec(text, "s.yaml").warnings)
    assert found.startswith("property 'p': it guards /cmd, and holds at every event of it, whatever the messages say")


def test_with_its_key_held_it_is_there_everywhere() -> None:
    filtered = STREAMS.replace("msg.speed}", "msg.speed}, action: filter")
    held = filtered.replace("amount: msg.amount}", "amount: msg.amount}, hold: [user]")
    text = f"{held}{KEYED}properties: [{{id: p, formula: '{{topic: /cmd}} -> not {{spent > 5}}', guards: [/cmd]}}]\n"
    assert parse_spec(text, "s.yaml").warnings == ()


def test_silence_that_is_not_seen_is_told() -> None:
    (found,) = told("properties: [{id: p, pattern: 'while {on}: /n every 2s'}]\n")
    assert found == (
        "pattern of 'p': silence does not violate it: `on` is not there when no message comes; name it under `hold` of "
        "its stream, so that it keeps its value"
    )
    for seen in ("while {mode: AUTO}: /n every 2s", "after /on until /on {on}: /n every 2s",
                 "while {on}: at most 3 /n within 1s"):  # fmt: skip
        assert told(f"properties: [{{id: p, pattern: '{seen}'}}]\n") == []


def test_texts_are_no_numbers_of_a_formula_over_numbers() -> None:
    found = told("properties: [{id: p, formula: '(mode > 2) or (n > 3)', engine: rtamt}]\n")
    assert (
        found[0] == "property 'p' is never judged: `mode` of /on, /n, /mode and 2 more is always a text, and no number"
    )


@pytest.mark.parametrize("forget", ["2s", "3s"])
def test_what_is_forgotten_has_not_left_its_state_in_time(forget: str) -> None:
    of = f"{{by: user, forget: {forget}, start: a, states: {{a: {{up: b}}, b: {{up: a, within: 3s}}}}}}"
    with pytest.raises(SpecError, match="write a `forget` that is longer than the `within` of 3s"):
        derived(of)
    assert derived(of.replace(f"forget: {forget}", "forget: 4s")) == []
