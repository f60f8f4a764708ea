"""Warnings of parts that never hold, or never fail: the common mistakes are found, and told with what to write."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest

from oracle_server.core.errors import Finding
from oracle_server.core.formula.tree import Constraint
from oracle_server.core.ranges import Range
from oracle_server.specfiles.load import parse_spec

HOLD = (
    "`{stopped}` never holds at an event of /cmd_vel: only /estop has `stopped`; name it under `hold` of /estop, so "
    "that it keeps its value"
)

STREAMS = """\
id: x
streams:
  - {topic: /cmd_vel, signals: {cmd: msg.linear.x}}
  - topic: /estop
    signals: {stopped: msg.data == true, mode: "msg.m == 1 ? 'IDLE' : 'AUTO'", id: string(msg.id)}
  - {topic: /battery, signals: {percent: msg.p, level: msg.l}, hold: [level]}
properties:
"""


def warnings(*formulas: str, **more: Any) -> tuple[Finding, ...]:
    rows = [{"id": f"p{i}", "formula": text, **more} for i, text in enumerate(formulas)]
    return parse_spec(STREAMS + "".join(f"  - {row}\n" for row in rows), "x.yaml").warnings


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        (
            '{topic: "/cmd_vel", cmd != 0} -> not {stopped}',
            HOLD,
        ),
        (
            'forall[i]. {topic: "/cmd_vel", cmd: *i} and not {stopped} -> once{percent: *i}',
            HOLD,
        ),
        (
            "historically{percent >= 20}",
            "`{percent >= 20}` is false at every event of /cmd_vel and /estop, which have no `percent`, so that "
            "`historically {percent >= 20}` is false for ever after the first one; write "
            "`historically ({percent: *} -> {percent >= 20})`",
        ),
        (
            '{level > 3} since[:4] {stopped} or once historically[:2]{topic: "/battery", percent > 5}',
            '`{topic: "/battery", percent > 5}` is false at every event of /cmd_vel and /estop, so that '
            '`historically[:2] {topic: "/battery", percent > 5}` is false while one is within its bound; write '
            '`historically[:2] ({topic: "/battery"} -> {topic: "/battery", percent > 5})`',
        ),
        (
            "{percent > 5} since {stopped}",
            "`{percent > 5}` is false at every event of /cmd_vel and /estop, which have no `percent`, so that each of "
            "them ends the `since`; write `({percent: *} -> {percent > 5}) since {stopped}`",
        ),
        (
            "{stopped} -> always[:4] {cmd: 0}",
            "`{cmd: 0}` is false at every event of /estop and /battery, which have no `cmd`, so that each of them "
            "within its bound breaks `always[:4] {cmd: 0}`; write `always[:4] ({cmd: *} -> {cmd: 0})`",
        ),
        (
            "{stopped} -> eventually[:4] always historically[:2] {cmd: 0}",
            "`{cmd: 0}` is false at every event of /estop and /battery, which have no `cmd`, so that "
            "`historically[:2] {cmd: 0}` is false while one is within its bound; write "
            "`historically[:2] ({cmd: *} -> {cmd: 0})`",
        ),
        (
            "{stopped} -> {cmd: 0} until[:4] {percent > 5}",
            "`{cmd: 0}` is false at every event of /estop and /battery, which have no `cmd`, so that each of them "
            "breaks the `until`, if its right side does not hold there; write "
            "`({cmd: *} -> {cmd: 0}) until[:4] {percent > 5}`",
        ),
        (
            'not ({topic: "/cmd_vel", cmd > 1} and {topic: "/estop"})',
            '`{topic: "/estop"}` never holds at an event of /cmd_vel, where alone it would matter: a step is one event '
            'of one stream; write `once {topic: "/estop"}` if it may have held before',
        ),
        (
            'exists[i]. {topic: "/estop", id: *i} -> once {topic: "/battery", level: *i}',
            "`exists[i].` holds at every event, whatever the messages say, since `->` holds for values that no "
            "event has had; write `forall[i].`, or `and` for `->`",
        ),
        (
            'exists[i]. exists[j]. {topic: "/estop", id: *i, mode: *j} -> once {topic: "/battery", level: *i}',
            "`exists[i, j].` holds at every event, whatever the messages say, since `->` holds for values that "
            "no event has had; write `forall[i, j].`, or `and` for `->`",
        ),
        (
            'exists[i]. not ({topic: "/estop", id: *i} and {stopped})',
            "`exists[i].` holds at every event, whatever the messages say, since what follows holds for values "
            "that no event has had; write `forall[i].`",
        ),
        (
            'forall[i]. {topic: "/estop", id: *i} and once {topic: "/battery", level: *i}',
            "`forall[i].` fails at every event, whatever the messages say, since what follows fails for values "
            "that no event has had; write `exists[i].`, or `->` for `and`",
        ),
        (
            '{topic: "/cmd_vel", cmd > 0} -> once[:5] {topic: "/cmd_vel"}',
            '`once[:5] {topic: "/cmd_vel"}` holds wherever `{topic: "/cmd_vel", cmd > 0}` does, so that the '
            "implication is always true",
        ),
        (
            '{topic: "/cmd_vel", cmd > 0} -> not {topic: "/estop"}',
            '`{topic: "/estop"}` never holds at an event of /cmd_vel, where alone it would matter: a step is one event '
            'of one stream; write `once {topic: "/estop"}` if it may have held before',
        ),
        (
            '{topic: "/cmd_vel", cmd > 0} -> lasting[2] {topic: "/battery"}',
            '`lasting[2] {topic: "/battery"}` never holds at an event of /cmd_vel, where alone it would matter: '
            '`{topic: "/battery"}` must hold at that event too, and is false there; write '
            '`once[:2] {topic: "/battery"}` if it may have held before',
        ),
        (
            '{cmd > 0} -> historically[:3] {topic: "/battery"}',
            '`historically[:3] {topic: "/battery"}` never holds at an event of /cmd_vel, where alone it would matter: '
            '`{topic: "/battery"}` must hold at that event too, and is false there; write '
            '`once[:3] {topic: "/battery"}` if it may have held before',
        ),
        (
            '{topic: "/estop"} -> ({topic: "/battery"} since {topic: "/cmd_vel"})',
            '`{topic: "/battery"} since {topic: "/cmd_vel"}` never holds at an event of /estop, where alone it would '
            'matter: `{topic: "/battery"}` must hold at that event too, and is false there; write '
            '`{topic: "/battery"} or {topic: "/estop"}` for its left side if such an event may have come since',
        ),
        ("{cmd > 1} or {kind: topic}", "it holds at every event, whatever the messages say; it can never be violated"),
        (
            "{mode: idle}",
            '`mode: "idle"` is never met: `mode` of /estop is always "IDLE" or "AUTO"; write `mode: "IDLE"`',
        ),
        ("{id: 3}", '`id: 3` is never met: `id` of /estop is always a text; write `id: "3"`'),
        (
            "{id > 3}",
            "`id > 3` is never met: `id` of /estop is always a text; texts and Booleans are neither smaller nor larger "
            "than a number",
        ),
        (
            "{stopped: True}",
            '`stopped: "True"` is never met: `stopped` of /estop is always true or false; write `stopped: true`',
        ),
        ("{id != 3}", '`id != 3` is met by every value: `id` of /estop is always a text; write `id != "3"`'),
        (
            "{cmd > 3, cmd < 2}",
            "`{cmd > 3, cmd < 2}` never holds: no value of `cmd` meets `cmd > 3` and `cmd < 2`",
        ),
        (
            "{percent >= 20}",
            "it is false at every event of /cmd_vel and /estop, which have no `percent`, and so is violated there, "
            "whatever the messages say; write `{percent: *} -> {percent >= 20}`",
        ),
        (
            "{percent < level}",
            "it is false at every event of /cmd_vel and /estop, which have no `percent`, and so is violated there, "
            "whatever the messages say; write `{percent: *} -> {percent < level}`",
        ),
    ],
)
def test_common_mistakes_are_told_with_their_mend(formula: str, message: str) -> None:
    assert [w.message for w in warnings(formula)] == [f"formula of 'p0': {message}"]


@pytest.mark.parametrize(
    "formula",
    [
        "{cmd > 1} -> eventually[:10] {cmd > 1}",
        "{cmd > 1} -> eventually[:10] {cmd > 0.5}",
        "{cmd > 1} -> not {stopped} until[:10] {cmd > 0}",
        "forall[g]. {cmd: *g} -> eventually[:10] {cmd: *g}",
    ],
)
def test_what_the_event_that_asks_answers_itself_is_told_of(formula: str) -> None:
    assert [w.message for w in warnings(formula)] == [
        "formula of 'p0': it holds at every event, whatever the messages say; it can never be violated; where the "
        "event that asks is the answer, write a lower bound, as in `eventually[1:60] …`"
    ]
    assert warnings(formula.replace("[:10]", "[1:10]")) == ()


@pytest.mark.parametrize(
    "formula",
    [
        '{topic: "/cmd_vel", cmd != 0} -> {level > 3}',
        'historically({topic: "/battery"} -> {percent > 5})',
        "historically({percent: *} -> {percent >= 20})",
        'historically not {topic: "/estop", stopped}',
        "{stopped} -> always[:4] {level > 3}",
        "{stopped} -> always[:4] not {cmd > 0}",
        "{stopped} -> always[:4] ({cmd: *} -> {cmd: 0})",
        '{topic: "/battery", percent < 5} -> lasting[2] {topic: "/battery"}',
        '{percent < 5} -> ({topic: "/battery"} since {topic: "/estop"})',
        'not ({topic: "/battery"} since[2:] {topic: "/estop"})',
        '{topic: "/estop"} -> pre ({topic: "/battery"} since {topic: "/cmd_vel"})',
        '{topic: "/estop"} -> pre lasting[2] {topic: "/battery"}',
        '{topic: "/cmd_vel", cmd > 0} -> lasting[2] not {topic: "/battery"}',
        '{topic: "/cmd_vel"} -> historically[1:3] {topic: "/battery"}',
        'not {topic: "/estop"} since[:10] {topic: "/cmd_vel"}',
        '{topic: "/battery"} or {topic: "/estop"} -> {percent > 5} or {stopped}',
        '{topic: "/cmd_vel", cmd > 1} -> once {mode: AUTO}',
        '{topic: "/cmd_vel"} -> pre {topic: "/cmd_vel"}',
        "{cmd: *} -> {cmd > 3, cmd < 4, cmd != 3.5}",
        "{id: *} -> {id != 'a'}",
        'not {id != "a"}',
        '{topic: "/estop"} or {topic: "/battery"}',
        'exists[i]. {topic: "/estop"} -> {topic: "/estop", id: *i} and once {topic: "/battery", level: *i}',
        'forall[i]. {topic: "/estop", id: *i} -> once {topic: "/battery", level: *i}',
        'forall[i]. {topic: "/estop", id: *i} -> exists[j]. once {mode: *i, id: *j}',
        'forall[i]. not ({topic: "/estop", id: *i} and pre once {topic: "/estop", id: *i})',
        'exists[i]. {topic: "/battery", level > 3} -> once {topic: "/battery", level: *i}',
    ],
)
def test_what_can_be_meant_is_not_warned_of(formula: str) -> None:
    assert warnings(formula) == ()


@pytest.mark.parametrize(
    ("asked", "is_idle"),
    [
        ("always[:5] not {level > 3}", False),
        ("always[:5] not {percent > 3}", True),
        ("always[:5] not {percent > 3} and always not {cmd > 0}", False),
        ("always[:5] not {percent > 3} and always not {mode: AUTO}", True),
        ("always[:5] ({cmd > 0} -> always[:5] not {percent > 3})", True),
        ("{id: *} and always[:5] not {percent > 3}", False),
        ("always[:5] not {cmd > 0}", False),
    ],
)
def test_a_guard_of_what_its_stream_never_breaks_denies_none(asked: str, *, is_idle: bool) -> None:
    guarded = STREAMS.replace("msg.linear.x}", "msg.linear.x}, action: filter")
    text = f"{guarded}  - {{id: p, formula: '{{stopped}} -> {asked}', guards: [/cmd_vel], blame: any}}\n"
    told = [w.message for w in parse_spec(text, "x.yaml").warnings]
    assert any(text.startswith("property 'p': it guards /cmd_vel, and holds at every") for text in told) is is_idle


def test_a_guard_of_an_action_denies_none_of_what_is_not_asked_of_it() -> None:
    text = """\
id: x
streams:
  - {ros_action: /dock, action: filter, goal: {signals: {x: msg.x}}, feedback: {signals: {left: msg.left}}}
properties:
  - {id: p, formula: '{kind: feedback} -> {left < 5}', guards: [/dock], blame: any}
"""
    (found,) = parse_spec(text, "x.yaml").warnings
    assert found.message.startswith("property 'p': it guards /dock, and holds at every event of it")
    assert parse_spec(text.replace("action: filter", "action: filter, ask: [goal, feedback]"), "x.yaml").warnings == ()


def test_what_never_can_come_is_not_told_to_be_the_answer() -> None:
    (found,) = warnings("always[:3] false")
    assert found.message == (
        "formula of 'p0': it fails at every event, whatever the messages say; write what must hold"
    )


ANEW = (
    "; `idle` begins anew with these events, and is 0 at each of them: to say how long they may stay away, ask for it "
    "alone, as `{idle <= 0.5}` with `time: seconds`"
)


@pytest.mark.parametrize(
    ("formula", "message"),
    [
        (
            "{topic: /cmd_vel} -> {idle < 0.5}",
            '`{idle < 0.5}` holds wherever `{topic: "/cmd_vel"}` does, so that the implication is always true' + ANEW,
        ),
        (
            "not {topic: /cmd_vel, idle > 0.5}",
            "`idle > 0.5` is never met: `idle` of /cmd_vel is always 0" + ANEW,
        ),
        (
            "{topic: /cmd_vel, idle >= 0} and {cmd: *} -> once[:3] {stopped}",
            "`idle >= 0` is met by every value: `idle` of /cmd_vel is always 0" + ANEW,
        ),
        (
            "not {topic: /cmd_vel, often < 1}",
            "`often < 1` is never met: `often` of /cmd_vel is always a whole number from 1 on",
        ),
        ("not {topic: /cmd_vel, of_five > 5}", "`of_five` of /cmd_vel is always a whole number from 1 to 5"),
        ("not {id: *, by_id > 0.5}", "`by_id > 0.5` is never met: `by_id` of /estop is always 0"),
        ("{topic: /estop} -> {idle < 0.5}", ""),
        ("{topic: /cmd_vel} -> {fast_idle < 0.5}", ""),
        ("not {topic: /cmd_vel, often > 5}", ""),
        ("{idle < 0.5}", ""),
        ("not {id: a, by_id > 0.5}", ""),  # a deadline has its key
        ("not {monitor: uav1, by_monitor > 0.5}", ""),
    ],
)
def test_an_age_that_is_asked_at_the_very_event_from_which_it_counts(formula: str, message: str) -> None:
    derived = """\
derive:
  idle: {age: '{topic: /cmd_vel}'}
  fast_idle: {age: '{topic: /cmd_vel, cmd > 1}'}
  often: {count: '{topic: /cmd_vel}', over: 2s}
  of_five: {count: '{topic: /cmd_vel}', over: 5}
  by_id: {age: '{topic: /estop}', by: id, forget: 1h}
  by_monitor: {age: '{topic: /estop}', by: monitor, forget: 1h}
"""
    time = "steps" if formula.startswith("not {id: *") else "seconds"
    row = f"  - {{id: p, formula: '{formula}', time: {time}}}\n"
    told = [w.message for w in parse_spec(STREAMS.replace("properties:", f"{derived}properties:") + row, "x").warnings]
    assert [message in each for each in told] == ([True] if message else [])


def test_the_mend_mends() -> None:
    assert warnings('{topic: "/cmd_vel", cmd != 0} -> not {stopped}')
    text = STREAMS.replace("id: string(msg.id)}", "id: string(msg.id)}\n    hold: [stopped]")
    assert (
        parse_spec(text + """  - {id: p, formula: '{topic: "/cmd_vel", cmd != 0} -> not {stopped}'}\n""", "x").warnings
        == ()
    )


def test_a_warning_stands_at_its_atom() -> None:
    (found,) = warnings('{topic: "/cmd_vel", cmd != 0} -> not {stopped}')
    assert (found.line, found.column, found.severity) == (8, 67, "warning")


def test_streams_that_are_alike_are_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[Constraint] = []
    meets = Range.meets

    def counted(self: Range, constraints: Sequence[Constraint]) -> bool:
        looked.extend(constraints)
        return meets(self, constraints)

    monkeypatch.setattr(Range, "meets", counted)
    numbers = []
    for many in (3, 300):
        streams = "".join(
            f"  - {{topic: /a{n}, signals: {{v: msg.v, w{n}: msg.w}}, hold: [w{n}]}}\n" for n in range(many)
        )
        properties = "".join(f"  - {{id: p{n}, formula: '{{v: {n}}} -> once {{w0 > 3}}'}}\n" for n in range(5))
        parse_spec(f"id: x\nstreams:\n{streams}properties:\n{properties}", "x.yaml")
        numbers.append(len(looked))
        looked.clear()
    assert numbers[0] == numbers[1] > 0


@pytest.mark.parametrize(
    ("formula", "last"),
    [
        ('{cmd: 0} -> not {topic: "/battery", percent: 100} since {topic: "/battery"}',
         '`{topic: "/battery", percent: 100}` ends nothing, since `{topic: "/battery"}` holds at each of its'),
        ("{cmd: 0} -> not {cmd > 2} since[:5] {cmd > 1}", "`{cmd > 2}` ends nothing, since `{cmd > 1}` holds at each"),
        ("forall[i]. {cmd: *i} -> not {id: *i} since {id: *}", "`{id: *i}` ends nothing, since `{id: *}` holds at"),
        ('{cmd: 0} -> not {topic: "/battery"} since {topic: "/battery", percent: 100}', None),
        ("{cmd: 0} -> not {cmd > 1} since {cmd > 2}", None),
        ("{cmd: 0} -> not {cmd > 2} since[1:] {cmd > 1}", None),
        ('{cmd: 0} -> not {topic: "/estop"} since {topic: "/battery"}', None),
    ],
)  # fmt: skip
def test_what_begins_with_each_event_that_ends_it_is_told(formula: str, last: str | None) -> None:
    found = [each.message for each in warnings(formula) if "ends nothing" in each.message]
    assert len(found) == (last is not None)
    assert all(last in each for each in found if last)


def test_a_scope_that_begins_and_ends_with_the_same_event_is_told_to_tell_them_apart() -> None:
    (found,) = warnings('{cmd: 0} -> not {topic: "/battery"} since {topic: "/battery"}')
    assert '`{topic: "/battery"}` ends nothing' in found.message
    assert "and not" not in found.message
    assert "which of these events begins and which one ends" in found.message


@pytest.mark.parametrize(
    ("formula", "either"),
    [
        ('{cmd: 0} or {mode != "IDLE"} or {mode != "AUTO"}', '{mode != "IDLE"} or {mode != "AUTO"}'),
        ('{topic: "/estop"} -> {id != "a"} or {id != "b"}', '{id != "a"} or {id != "b"}'),
        ('{topic: "/battery"} -> {level != 1} or {level != 2}', "{level != 1} or {level != 2}"),
        ('{topic: "/battery", level != 1} or {topic: "/battery", level != 2}', '{topic: "/battery", level != 1} or'),
        ('{topic: "/estop"} -> {stopped != true} or {stopped != false}', "{stopped != true} or {stopped != false}"),
        ("{stopped: *} -> {stopped != true} or {stopped != false}", None),
        ("{percent: *} -> {level != 1} and {level != 2}", None),
        ("{percent: *} -> {level != 1} or {percent != 1}", None),
        ("{percent: *} -> {level < 1} or {level > 2}", None),
        ("{percent: *} -> {level < 3} or {level > 2}", None),
        ("{stopped: *} -> {stopped} or {stopped: false}", None),
        ('{topic: "/cmd_vel"} -> {level != 1} or not {level != 2}', None),
    ],
)  # fmt: skip
def test_alternatives_of_which_one_always_holds_are_told(formula: str, either: str | None) -> None:
    found = [each.message for each in warnings(formula) if "holds for every value" in each.message]
    assert len(found) == (either is not None)
    assert all(f"`{either}" in each for each in found)
