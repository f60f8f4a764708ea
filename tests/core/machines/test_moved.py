"""What `check` says of a machine's state that is asked for at the event by which the machine has left it."""

from __future__ import annotations

import pytest

from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: s
streams:
  - {topic: /gripper, signals: {cmd: msg.cmd, hand: msg.hand}}
  - {topic: /arm, signals: {phase: msg.phase}}
define:
  close: '{cmd: close}'
  open: '{cmd: open} or {cmd: drop}'
  lift: '{phase: lift}'
derive:
  st:
    start: empty
    otherwise: stay
BY
    states:
      empty: {close: holding}
      holding: {lift: lifted, open: empty}
      lifted: {open: empty, close: lifted}
properties:
  - {id: p, PROPERTY}
"""


def told(prop: str, by: str = "") -> list[str]:
    text = SPEC.replace("PROPERTY", prop).replace("BY\n", f"    {by}\n" if by else "")
    return [each.message for each in parse_spec(text, "s.yaml").warnings if "has moved 'st' by then" in each.message]


@pytest.mark.parametrize(
    ("prop", "state", "event"),
    [
        ("formula: 'not ({cmd: open} and {st: lifted})'", "lifted", "open"),
        ("formula: '{cmd: drop} -> not {st: holding}'", "holding", "open"),
        ("formula: 'not {topic: /gripper, cmd: open, st: lifted}'", "lifted", "open"),
        ("formula: '{phase: lift} -> {st: holding}'", "holding", "lift"),
        ("pattern: 'while {st: lifted}: no /gripper {cmd: open}'", "lifted", "open"),
    ],
)
def test_a_state_at_the_event_that_leaves_it_is_told_of(prop: str, state: str, event: str) -> None:
    (found,) = told(prop)
    assert f'`{{st: "{state}"}}` never holds where `{event}` does' in found
    assert found.endswith(f'write `pre {{st: "{state}"}}` for the state before it')
    (found,) = told(prop, by="by: hand\n    forget: 1h") if "lift}" not in prop else [""]
    assert not found or found.endswith(f"let `{event}` lead to `error` where it must not come, and ask `machine: st`")


@pytest.mark.parametrize(
    "prop",
    [
        "formula: 'not ({cmd: open} and pre {st: lifted})'",
        "formula: 'not ({cmd: close} and {st: lifted})'",
        "formula: 'not ({phase: lift} and {st: empty})'",
        "formula: 'not ({cmd: open} and {st: empty})'",
        "formula: 'not ({topic: /gripper} and {st: lifted})'",
        "formula: 'not ({hand: left} and {st: lifted})'",
        "formula: '{cmd: open} -> once {st: lifted}'",
        "formula: '{cmd: open} -> not {st: lifted} or {hand: left}'",
    ],
)
def test_a_state_that_may_be_there_is_not(prop: str) -> None:
    assert told(prop) == []
