"""What the board shows of violations, their episodes, and what is taken back."""

from __future__ import annotations

from typing import Any, Dict, Optional

from oracle_adapter import Board, Stats
from oracle_adapter.screen import ERROR, OK, STALE, WARN
from tests.adapters.common.boards import CAUSE, REVISION, Clock, Screen, statuses, told


def test_a_violation_is_told_with_its_property_its_event_and_why(
    screen: Screen, board: Board
) -> None:
    event = {"stream": "/a", "kind": "topic", "seq": 3, "monitor": "m"}
    record = {"n": 4, "property": "p", "step": 2, **event}
    board.on_violation({**record, "explanation": {"text": "p fails, since it is late"}})
    board.on_violation(record)
    board.on_violation({})
    assert screen.errors[0] == "violation: p fails, since it is late (#4)"
    assert screen.errors[1] == "violation: p does not hold at step 2, /a (topic 3 of m) (#4)"
    assert len(screen.errors) == 3


EPISODE = {
    "property": "near",
    "first": 12,
    "began": 10**18 + 12 * 10**6,
    "last": 40,
    "until": 10**18 + 1_500 * 10**6,
    "count": 3,
    "worst": {"signal": "gap", "op": ">=", "bound": 0.5, "value": 0.25},
    "explanation": None,
    "moved": False,
}


def test_an_episode_is_one_line_where_it_begins_and_one_where_it_ends(
    screen: Screen, board: Board
) -> None:
    why = "near does not hold at step 4: gap = 0.25, wanted >= 0.5"
    board.on_episode({**EPISODE, "event": "begun", "explanation": why})
    board.on_episode({**EPISODE, "event": "ended"})
    board.on_episode(
        {
            **EPISODE,
            "event": "ended",
            "count": 1,
            "until": EPISODE["began"],
            "last": 12,
            "worst": None,
        }
    )
    board.on_episode({**EPISODE, "event": "retracted"})
    assert screen.errors == [
        f"violation: {why} (#12)",
        "over: near was violated 3 times, from 01:46:40.012Z on, and still at 01:46:41.500Z, "
        "at worst gap = 0.25, wanted >= 0.5 (#12 to #40)",
        "over: near was violated once, 01:46:40.012Z (#12)",
        "retracted: near was not violated at 01:46:40.012Z (#12): what came late shows it",
    ]


def test_an_episode_that_only_has_another_beginning_is_told_no_more(
    screen: Screen, board: Board
) -> None:
    for event in ("retracted", "begun"):
        board.on_episode({**EPISODE, "event": event, "moved": True})
    board.on_episode({**EPISODE, "event": "what a later server says"})
    board.on_episode({})
    assert screen.errors == []


def standing(level: str, violations: int, *, is_open: Optional[bool]) -> Dict[str, Any]:
    """A `verdicts` frame with episodes; `is_open` is None where there is none."""
    frame = told("unknown", near=(level, "text"))
    episode = None if is_open is None else {"first": 12, "began": 0, "open": is_open}
    frame["properties"]["near"].update(violations=violations, episode=episode)
    return frame


def level(screen: Screen, board: Board) -> int:
    board.tick(Stats())
    return statuses(screen)["uav1: near"][0]


def test_diagnostics_warn_while_an_episode_is_open_and_ten_seconds_after(
    screen: Screen, board: Board, clock: Clock
) -> None:
    board.on_state("attached", "s1")
    board.on_verdicts(standing("ok", 0, is_open=None))
    assert level(screen, board) == OK
    board.on_verdicts(standing("warn", 1, is_open=True))
    clock.now = 100.0
    assert level(screen, board) == WARN
    board.on_verdicts(standing("ok", 1, is_open=True))
    assert level(screen, board) == WARN, "it holds for less than the gap between two episodes"
    board.on_verdicts(standing("stale", 1, is_open=True))
    assert level(screen, board) == WARN, "nothing is known of it since"
    board.on_verdicts(standing("error", 1, is_open=True))
    assert level(screen, board) == ERROR
    board.on_verdicts(standing("ok", 1, is_open=False))
    clock.now = 105.0
    board.on_verdicts(standing("ok", 1, is_open=None))
    clock.now = 109.9
    for worse, shown in (("error", ERROR), ("stale", STALE)):
        board.on_verdicts(standing(worse, 1, is_open=None))
        assert level(screen, board) == shown, "what is worse than a warning is shown as it is"
    board.on_verdicts(standing("ok", 1, is_open=None))
    board.on_state("disconnected", "gone")
    board.on_state("attached", "s1")
    assert level(screen, board) == WARN, "of the same session, whatever the link did"
    assert statuses(screen)["uav1: near"][1] == "text; it did not less than 10 s ago"
    clock.now = 110.0
    assert level(screen, board) == OK


def test_episodes_are_those_of_one_session(screen: Screen, board: Board) -> None:
    board.on_state("attached", "s1")
    board.on_verdicts(standing("warn", 1, is_open=True))
    assert level(screen, board) == WARN
    board.on_state("attached", "s2")
    board.on_verdicts(standing("ok", 0, is_open=None))
    assert level(screen, board) == OK
    board.on_verdicts(standing("ok", 1, is_open=None))
    board.on_state("attached", "s3")
    board.on_verdicts(standing("ok", 1, is_open=False))
    assert level(screen, board) == WARN, "its own, though it has as many violations"


def test_an_episode_between_two_commits_is_shown_for_ten_seconds_too(
    screen: Screen, board: Board, clock: Clock
) -> None:
    board.on_state("attached", "s1")
    board.on_verdicts(standing("ok", 4, is_open=None))
    assert level(screen, board) == OK, "they were before"
    board.on_verdicts(standing("ok", 5, is_open=None))
    clock.now = 9.9
    assert level(screen, board) == WARN
    clock.now = 10.0
    assert level(screen, board) == OK
    board.on_state("attached", "s2")
    board.on_verdicts(standing("ok", 7, is_open=None))
    assert level(screen, board) == OK, "another session's numbers are its own"


def test_what_an_older_server_says_is_shown_as_it_was(
    screen: Screen, board: Board, clock: Clock
) -> None:
    board.on_state("attached", "s1")
    for violations in (1, 2):
        frame = told("currently_true", near=("ok", "holds"))
        frame["properties"]["near"]["violations"] = violations
        board.on_verdicts(frame)
        assert level(screen, board) == OK


def test_a_retraction_is_told_as_that_of_an_episode_where_the_server_has_these(
    screen: Screen, board: Board
) -> None:
    board.on_state("attached", "s1")
    board.on_verdicts(standing("ok", 0, is_open=None))
    board.on_revision({**REVISION, "retracted": True})
    assert screen.errors == []


def test_what_is_taken_back_is_told_with_its_step_and_what_came_late(
    screen: Screen, board: Board
) -> None:
    board.on_state("attached", "s1")
    board.on_violation({"n": 12, "property": "near", "step": 40, "stamp": 10**18 + 12 * 10**6})
    board.on_revision({**REVISION, "retracted": True})
    board.on_revision({**REVISION, "retracted": True, "causes": 3})
    assert screen.errors[1:] == [
        f"retracted: near is not violated at step 40 (01:46:40.012Z) (#12): {CAUSE}",
        f"retracted: near is not violated (#12): {CAUSE}, and 2 more",
    ]


def test_other_revisions_are_told_by_the_verdicts_that_they_change(
    screen: Screen, board: Board
) -> None:
    board.on_revision({**REVISION, "retracted": False, "violation": False})
    board.on_revision({**REVISION, "violation": True})
    assert screen.errors == []


def test_a_violation_that_appears_says_since_when_it_is_known_and_may_be_taken_back(
    screen: Screen, board: Board
) -> None:
    why = {"text": "near does not hold at step 40", "event": {"stamp": 10**18 + 9 * 10**6}}
    board.on_violation({**REVISION, "violation": True, "explanation": why})
    assert screen.errors == [f"violation: near does not hold at step 40; known since {CAUSE} (#57)"]
    board.on_revision({**REVISION, "n": 90, "retracted": True})
    assert screen.errors[1] == f"retracted: near is not violated at 01:46:40.009Z (#12): {CAUSE}"
