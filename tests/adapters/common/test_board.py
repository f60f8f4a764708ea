"""What the board shows of the oracle, and what it keeps to itself."""

from __future__ import annotations

from typing import Any, Dict, Optional

import pytest
from oracle_adapter import Answer, Board, LinkError, Stats, graph_name
from oracle_adapter.screen import ERROR, OK, STALE, WARN
from oracle_adapter.violations import MOST
from tests.adapters.common.boards import CAUSE, REVISION, Clock, Screen, statuses, told

DENIED = Answer("decision", "deny", ("p", "q"))
ALLOWED = Answer("decision", "allow")
SILENT = Answer("timeout", reason="no decision in time")
AWAY = Answer("unavailable", reason="no connection to the oracle")


def test_nothing_is_known_until_the_oracle_has_spoken(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    assert screen.verdicts == ["unknown"]
    board.on_verdicts(told("currently_true"))
    assert screen.verdicts == ["unknown", "currently_true"]


def test_a_verdict_is_shown_where_it_changes_and_forgotten_with_the_link(
    screen: Screen, board: Board
) -> None:
    board.on_state("attached", "s1")
    for worst in ("currently_true", "currently_true", "false"):
        board.on_verdicts(told(worst))
    board.on_state("disconnected", "gone")
    board.on_state("attached", "s1")
    board.on_verdicts(told("false"))
    board.on_state("ended", "closed")
    assert screen.verdicts == ["unknown", "currently_true", "false", "unknown", "false", "unknown"]


def test_diagnostics_say_what_the_server_says(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    levels = {
        "a": ("ok", "holds"),
        "b": ("warn", "no"),
        "c": ("error", "never"),
        "d": ("stale", "?"),
    }
    board.on_verdicts(told("false", **levels))
    board.tick(Stats())
    assert statuses(screen) == {
        "uav1: oracle": (OK, "attached to session s1"),
        "uav1: a": (OK, "holds"),
        "uav1: b": (WARN, "no"),
        "uav1: c": (ERROR, "never"),
        "uav1: d": (STALE, "?"),
    }
    values = dict(screen.shown[-1][1].values)
    assert values == {
        "outcome": "unknown",
        "violations": "2",
        "first at": "-",
        "first_violation": "7",
    }


@pytest.mark.parametrize(
    ("step", "stamp", "text"),
    [
        (3, 1_732_147_230_012_999_999, "step 3, 00:00:30.012Z"),
        (None, 1_732_147_230_012_999_999, "00:00:30.012Z"),
        (3, 12_500_000_000, "step 3, 12.500 s"),
        (None, None, "-"),
    ],
)
def test_diagnostics_say_where_a_property_was_violated_first(
    screen: Screen, board: Board, step: Optional[int], stamp: Optional[int], text: str
) -> None:
    frame = told("false", a=("warn", "no"))
    frame["properties"]["a"].update(first_violation_step=step, first_violation_at=stamp)
    board.on_verdicts(frame)
    board.tick(Stats())
    assert dict(screen.shown[-1][1].values)["first at"] == text


def test_all_is_stale_while_the_oracle_is_away(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    board.on_verdicts(told("currently_true", a=("ok", "holds")))
    board.on_state("disconnected", "no sign of life")
    board.tick(Stats())
    assert {level for level, _ in statuses(screen).values()} == {STALE}
    assert statuses(screen)["uav1: oracle"][1] == "the oracle is away: no sign of life"
    assert "holds" in statuses(screen)["uav1: a"][1]


def test_an_attached_oracle_that_does_not_decide_is_stale_too(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    board.settle(SILENT, "deny", "a message of /a")
    board.tick(Stats())
    assert statuses(screen)["uav1: oracle"][0] == STALE
    board.settle(ALLOWED, "deny", "a message of /a")
    board.tick(Stats())
    assert statuses(screen)["uav1: oracle"][0] == OK


def test_diagnostics_come_at_once_where_they_change_and_each_second_anyway(
    screen: Screen, board: Board, clock: Clock
) -> None:
    board.tick(Stats())
    board.tick(Stats(sent=1))
    assert len(screen.shown) == 1
    board.on_state("attached", "s1")
    board.tick(Stats())
    assert len(screen.shown) == 2
    clock.now = 0.9
    board.tick(Stats())
    assert len(screen.shown) == 2
    clock.now = 1.0
    board.tick(Stats(sent=5))
    assert len(screen.shown) == 3
    assert dict(screen.shown[-1][0].values)["sent"] == "5"


def test_a_denial_is_told_each_time_with_who_denies(screen: Screen, board: Board) -> None:
    assert board.settle(DENIED, "pass", "a request of /set, call 1") == (False, "decision")
    assert board.settle(ALLOWED, "deny", "a request of /set, call 2") == (True, "decision")
    assert board.settle(DENIED, "pass", "a request of /set, call 3") == (False, "decision")
    assert screen.errors == [
        "denied a request of /set, call 1: p, q",
        "denied a request of /set, call 3: p, q",
    ]


def test_an_outage_is_told_once_and_counted(screen: Screen, board: Board, clock: Clock) -> None:
    for _ in range(3):
        assert board.settle(SILENT, "pass", "a message of /a") == (True, "timeout")
    for _ in range(2):
        assert board.settle(AWAY, "deny", "a request of /b") == (False, "unavailable")
    (begun,) = screen.errors
    assert begun.startswith("passed a message of /a: no decision in time; ")
    clock.now = 5.0
    board.settle(ALLOWED, "deny", "a message of /a")
    assert screen.infos == [
        "the oracle is back after 5.0 s, in which 3 passed and 2 denied without it"
    ]
    board.settle(AWAY, "deny", "a message of /a")
    assert len(screen.errors) == 2, "a new outage is told again"
    assert screen.errors[1].startswith("denied a message of /a: no connection to the oracle; ")
    board.on_state("disconnected", "gone")
    assert len(screen.infos) == 2
    board.on_state("attached", "s1")
    assert screen.infos[-1].endswith("0 passed and 1 denied without it"), "no decision is needed"
    board.settle(ALLOWED, "deny", "a message of /a")
    assert screen.infos[-1].endswith("0 passed and 1 denied without it"), "it is told once"
    board.tick(Stats())
    values = dict(screen.shown[-1][0].values)
    assert (values["passed without a decision"], values["denied without a decision"]) == ("3", "3")


def test_what_may_be_wrong_is_a_warning_where_nothing_else_is_wrong(
    screen: Screen, board: Board
) -> None:
    assert board.trouble("/a", "", "nobody publishes /a")
    assert not board.trouble("/a", "", "nobody publishes /a")
    board.tick(Stats())
    assert statuses(screen)["uav1: /a"] == (WARN, "nobody publishes /a")
    assert (screen.infos, screen.errors) == (["/a: nobody publishes /a"], [])
    assert board.trouble("/a", "published past the monitor", "nobody publishes /a")
    board.tick(Stats())
    assert statuses(screen)["uav1: /a"] == (ERROR, "published past the monitor")
    assert board.trouble("/a", "")
    board.tick(Stats())
    assert statuses(screen)["uav1: /a"] == (OK, "recovered")


def test_trouble_is_told_where_it_is_new_and_shown_until_it_is_over(
    screen: Screen, board: Board
) -> None:
    assert board.trouble("/a", "published past the monitor")
    assert not board.trouble("/a", "published past the monitor")
    assert not board.trouble("/b", "")
    board.tick(Stats())
    assert statuses(screen)["uav1: /a"] == (ERROR, "published past the monitor")
    assert screen.errors == ["/a: published past the monitor"]
    assert board.trouble("/a", "")
    board.tick(Stats())
    assert statuses(screen)["uav1: /a"] == (OK, "recovered")
    assert "uav1: /b" not in statuses(screen)


def test_what_was_wrong_with_a_stream_that_is_observed_no_more_is_shown_no_more(
    screen: Screen, board: Board
) -> None:
    for name in ("/a", "/b"):
        board.trouble(name, "nobody publishes it")
    board.keep(["/b", "/c"])
    board.tick(Stats())
    assert [name for name in statuses(screen) if "/" in name] == ["uav1: /b"]
    assert board.trouble("/a", "nobody publishes it")


def test_numbers_are_those_of_one_session(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    board.on_violation({"n": 12, "property": "near", "step": 40})
    board.on_state("disconnected", "gone")
    board.on_state("attached", "s2")
    board.on_revision({**REVISION, "retracted": True})
    assert screen.errors[1] == f"retracted: near is not violated (#12): {CAUSE}"


def test_what_was_told_before_a_reconnect_is_known_after_it(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    board.on_violation({"n": 12, "property": "near", "step": 40})
    board.on_state("disconnected", "gone")
    board.on_state("attached", "s1")
    board.on_revision({**REVISION, "retracted": True})
    assert screen.errors[1] == f"retracted: near is not violated at step 40 (#12): {CAUSE}"


def test_many_violations_are_not_remembered_for_ever(screen: Screen, board: Board) -> None:
    for n in range(1, MOST + 2):
        board.on_violation({"n": n, "property": "near", "step": n})
    for n in (1, 2):
        board.on_revision({**REVISION, "revises": {"from": n, "to": n}, "retracted": True})
    assert screen.errors[-2:] == [
        f"retracted: near is not violated (#1): {CAUSE}",
        f"retracted: near is not violated at step 2 (#2): {CAUSE}",
    ]


def test_a_revision_that_says_little_is_told_as_far_as_it_goes(
    screen: Screen, board: Board
) -> None:
    board.on_revision({})
    board.on_revision({"retracted": True})
    assert screen.errors == ["retracted: None is not violated (#None): ? (? ? of ?) came late"]


@pytest.mark.parametrize(
    ("monitor", "name"),
    [
        ("uav1", "/uav1"),
        ("/fleet/uav-1/", "/fleet/uav_1"),
        ("a.b", "/a_b"),
        ("7", "/_7"),
        ("a/7", "/a/_7"),
        ("a--b__c", "/a_b_c"),
        ("~", "/_"),
        ("/", "/monitor"),
    ],
)
def test_a_monitors_topics_have_names_that_ros_takes(monitor: str, name: str) -> None:
    assert graph_name(monitor) == name


def test_no_robot_writes_to_the_operators_terminal(board: Board, screen: Screen) -> None:
    forged = "x\x1b[2J\r\nviolation 99: \u202e\u2028\x07\ud800"
    board.on_violation({"explanation": {"text": forged}, "property": forged, "n": 1})
    board.on_revision({**REVISION, "retracted": True, "property": forged})
    board.on_state("attached", forged)
    board.error(forged)
    board.trouble("/a", forged)
    board.on_verdicts(
        {
            "worst": "unknown",
            "properties": {"p": {"level": "error", "text": forged, "outcome": forged}},
        }
    )
    board.tick(Stats())
    statuses = screen.shown[-1]
    values = [value for status in statuses for _, value in status.values]
    shown = [
        *screen.errors,
        *screen.infos,
        *values,
        *(s.message for s in statuses),
        str(LinkError("x", forged)),
    ]
    assert len([text for text in shown if "x\\x1b[2J\\r\\nviolation 99" in text]) >= 7
    assert all(text.isprintable() for text in shown)


@pytest.mark.parametrize(
    "frame",
    [
        {"properties": {"safe": 1}, "worst": "true"},
        {"properties": {"safe": {"level": "ok"}}, "worst": "true"},
        {"properties": {"safe": {"level": [], "text": "holds"}}, "worst": "true"},
        {"properties": {"safe": {"level": "ok", "text": "", "episode": 1}}, "worst": "true"},
        {"properties": ["safe"], "worst": "true"},
        {"properties": {}},
    ],
)
def test_verdicts_that_cannot_be_read_are_unknown_and_told(
    frame: Dict[str, Any], screen: Screen, board: Board
) -> None:
    board.on_state("attached", "s")
    board.on_verdicts(frame)
    board.tick(Stats())
    assert screen.verdicts == ["unknown"]
    assert "properties: what the oracle says of them can't be read" in screen.errors[-1]
    board.on_verdicts(told("true", safe=("ok", "holds")))
    board.tick(Stats())
    assert screen.verdicts == ["unknown", "true"]
    assert "properties: recovered" in screen.infos[-1]
