"""What is said of machines that are written wrong: each with its place and the nearest word."""

from __future__ import annotations

import pytest

from oracle_server.core.errors import SpecError
from oracle_server.specfiles.load import parse_spec

SPEC = """\
id: robot
streams:
  - {topic: /mode, signals: {mode: msg.data}}
  - {topic: /transition, signals: {node: msg.node, transition: msg.transition}}
  - {topic: /file, signals: {op: msg.op, handle: msg.handle}}
define:
  configure: '{transition: configure}'
  activate: '{transition: activate}'
  at(n): '{transition: configure, node: *n}'
  lately: 'once[:3] {transition: cleanup}'
  open: '{op: open}'
  read: '{op: read}'
  close: '{op: close}'
derive:
  modes: {follows: mode, states: {IDLE: [AUTO], AUTO: [IDLE, FAULT], FAULT: [IDLE]}}
  nav:
    {by: node, forget: 1h, start: off, states: {off: {configure: ready}, ready: {activate: on, configure: off}, on: {}}}
  file: {sequence: 'open read* close', by: handle, forget: 1h}
properties:
  - {id: modes_ok, machine: modes}
  - {id: nav_ok, machine: nav}
  - {id: file_ok, machine: file}
  - {id: used, formula: '{op: read} or not lately'}
"""
USED = "at(n): '{transition: configure, node: *n}'"


def told(text: str) -> list[str]:
    try:
        return [str(each) for each in parse_spec(text, "s.yaml").warnings]
    except SpecError as error:
        return [str(each) for each in error.findings]


def test_what_is_right_is_sound() -> None:
    assert [t for t in told(SPEC) if "`at`" not in t] == []


@pytest.mark.parametrize(
    ("was", "wrong", "message", "at"),
    [
        ("machine: modes", "machine: mode", "machine of 'modes_ok': 'mode' is unknown; did you mean `modes`?", "mode}"),
        ("machine: nav", "machine: modes, latch: 1", "`latch`", ""),
        ("[IDLE, FAULT]", "[IDLE, FAUTL]", "'modes': unknown state 'FAUTL'; did you mean `FAULT`?", "FAUTL"),
        ("{configure: ready}", "{confgure: ready}",
         "derived signal 'nav': unknown event 'confgure'; did you mean `configure`?", "confgure"),
        ("{configure: ready}", "{configure: redy}",
         "derived signal 'nav': unknown state 'redy'; did you mean `ready`?", "redy"),
        ("by: node", "by: [node, nod]", "derived signal 'nav': unknown signal 'nod'; did you mean `node`?", ""),
        ("by: node", "by: [node, node]", "derived signal 'nav': a signal stands twice in `by`", "[node"),
        ("by: node", "by: []", "`by`", ""),
        ("by: node, forget: 1h, start: off, states: {off: {configure: ready}",
         "by: [node, op], forget: 1h, start: off, states: {off: {configure: ready, within: 3s}",
         "derived signal 'nav': with several signals in `by` there is no `within`", "3s"),
        ("  modes:", "  many: {count: '{op: read}', over: 2s, by: [node, handle]}\n  modes:",
         "`count` is kept by one signal: `by: node`; by several there are machines alone", "by: [node, handle"),
        ("{configure: ready}", "{at: ready}", "`at(n)` has variables, and an event has none", ""),
        ("{configure: ready}", "{lately: ready}", "an event of a machine takes what holds at one step", ""),
        ("start: off", "start: of", "derived signal 'nav': unknown state 'of'; did you mean `off`?", "of,"),
        (" start: off,", "", "where does it begin? write `start: off`", ""),
        ("activate: '{transition: activate}'", "activate: '{transition: configure}'",
         "`configure` is the same as `activate`, so that it never counts", ""),
        ("on: {}", "on: {}, lost: {}", "warning: derived signal 'nav': no event leads to the state 'lost'", "lost"),
        ("FAULT: [IDLE]}", "FAULT: [IDLE], error: [IDLE]}", "`error` is what the machine is in after a change", ""),
        ("follows: mode", "follows: mod", "derived signal 'modes': unknown signal 'mod'; did you mean `mode`?", "mod,"),
        ("follows: mode", "follows: mode, otherwise: stay", "with `follows` there is no `otherwise`", ""),
        ("open read* close", "open raed* close",
         "derived signal 'file': unknown event 'raed'; did you mean `read`?", "raed"),
        ("sequence: 'open", "over: 2s, sequence: 'open", "a machine takes no `over`", ""),
        ("on: {}", "on: {within: 30}", "`within`: expected a duration", ""),
        ("on: {}", "on: {leave: maybe}", "`leave` is true, for a state that is to be left again", ""),
        ("machine: nav", "formula: 'not {nav: onn}'", "`{nav: \"onn\"}` is never met; did you mean `on`?", ""),
        ("machine: nav", "formula: 'not {nav > 1}'", "'nav' is the state of a machine, and no number", ""),
        ("machine: nav", "machine: nav, engine: reelay", "a machine is judged by the project's own engine", ""),
        (", forget: 1h, start", ", start", "write `forget: 1h`", ""),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_at_its_place(was: str, wrong: str, message: str, at: str) -> None:
    assert SPEC.count(was) == 1, was
    text = SPEC.replace(was, wrong)
    found = [each for each in told(text) if message in each]
    assert found, told(text)
    before = text[: text.index(wrong) + wrong.index(at)] if at in wrong else text[: text.rindex(f" {at}") + 1]
    assert not at or found[0].startswith(f"s.yaml:{before.count(chr(10)) + 1}:{len(before) - before.rfind(chr(10))}:")
    assert not any("is no machine" in each for each in told(text))


NUMBERED = """\
id: robot
streams: [{topic: /a, signals: {n: msg.n, b: msg.b}}]
derive:
  steps: {follows: n, states: {1: [2], 2: [1, 3], 3: []}}
  open: {follows: b, states: {true: ["false"], false: ["true"]}}
properties: [{id: p, formula: 'not {ASKED}'}]
"""


@pytest.mark.parametrize(
    ("asked", "signal", "mend"),
    [
        ("steps: 3", "steps", '"3"'),
        ("steps: 3.0", "steps", '"3"'),
        ("steps != 3", "steps", '"3"'),
        ("open", "open", '"true"'),
        ("open: false", "open", '"false"'),
    ],
)
def test_a_state_that_is_asked_for_as_a_number_is_to_be_put_in_quotes(asked: str, signal: str, mend: str) -> None:
    (found,) = told(NUMBERED.replace("ASKED", asked))
    assert f"met; a state is a text: write `{mend}`; '{signal}' is one of " in found
    assert told(NUMBERED.replace("ASKED", f"{signal}: {mend}")) == []


def test_the_order_of_events_is_part_of_what_a_spec_means() -> None:
    other = SPEC.replace("activate: on, configure: off", "configure: off, activate: on")
    assert parse_spec(SPEC, "a").spec.digest != parse_spec(other, "b").spec.digest
