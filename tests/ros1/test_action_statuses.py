"""How an action's goals stand, as clients are to see it: without nodes."""

from __future__ import annotations

from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from oracle_ros1.actionmessages import covers, text_of
from oracle_ros1.actionstatus import LAG, SHOWN, Statuses, accepted, status, word
from rospy import Time

ACTIVE, SUCCEEDED, ABORTED, REJECTED = (
    GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED
)  # fmt: skip


def array(**codes: int) -> GoalStatusArray:
    return GoalStatusArray(status_list=[GoalStatus(GoalID(id=goal), code, "") for goal, code in codes.items()])


def seen(statuses: Statuses, now: float) -> dict[str, int]:
    shown = statuses.view(now)
    assert shown is not None
    return {entry.goal_id.id: entry.status for entry in shown.status_list}


def test_changes_are_the_difference_to_the_last_array() -> None:
    statuses = Statuses()
    assert statuses.changes(array(a=ACTIVE, b=ACTIVE)) == [("a", ACTIVE), ("b", ACTIVE)]
    assert statuses.changes(array(a=ACTIVE, b=SUCCEEDED)) == [("b", SUCCEEDED)]
    assert statuses.changes(array(b=SUCCEEDED)) == []
    assert statuses.changes(array(a=ACTIVE)) == [("a", ACTIVE)]


def test_an_array_to_which_nothing_is_added_is_shown_as_it_is() -> None:
    statuses = Statuses()
    assert statuses.view(0) is None
    same = array(a=ACTIVE)
    statuses.changes(same)
    assert statuses.view(0) is same


def test_a_refused_goal_is_shown_for_a_time_and_is_no_change() -> None:
    statuses = Statuses()
    statuses.changes(array(a=ACTIVE))
    statuses.give(status(GoalID(id="x"), REJECTED, "denied"), 0)
    assert statuses.rewriting
    assert seen(statuses, SHOWN - 1) == {"a": ACTIVE, "x": REJECTED}
    assert statuses.changes(array(a=ACTIVE, x=GoalStatus.RECALLING)) == []  # by a cancel of it
    assert seen(statuses, SHOWN + 1) == {"a": ACTIVE, "x": REJECTED}
    statuses.changes(array(a=ACTIVE))
    assert seen(statuses, SHOWN + 1) == {"a": ACTIVE}
    assert not statuses.rewriting


def test_no_end_is_shown_while_the_result_is_decided_on() -> None:
    statuses = Statuses()
    statuses.open("a")
    statuses.changes(array(a=ACTIVE))
    assert seen(statuses, 0) == {"a": ACTIVE}
    statuses.deciding("a")
    assert statuses.changes(array(a=SUCCEEDED)) == [("a", SUCCEEDED)]
    assert seen(statuses, 10 * LAG) == {"a": ACTIVE}
    statuses.give(status(GoalID(id="a"), ABORTED, "denied"), 10 * LAG)
    statuses.settled("a")
    assert seen(statuses, 100 * SHOWN) == {"a": ABORTED}  # as long as the server shows it


def test_an_end_whose_result_does_not_come_is_shown_after_all() -> None:
    statuses = Statuses()
    statuses.open("a")
    statuses.changes(array(a=SUCCEEDED))
    assert seen(statuses, 0) == {"a": GoalStatus.PENDING}
    assert seen(statuses, LAG + 0.1) == {"a": SUCCEEDED}
    assert not statuses.rewriting


def test_words_and_replies_of_statuses() -> None:
    words = "unknown executing canceled succeeded aborted rejected canceling canceling canceled unknown"
    assert [word(code) for code in range(10)] == words.split()
    assert [accepted(code) for code in range(10)] == [None, True, True, True, True, False, True, None, False, None]


def test_cancels_are_about_goals_as_servers_read_them() -> None:
    goal = GoalID(id="a", stamp=Time(5))
    assert covers(GoalID(), goal)
    assert covers(GoalID(id="a"), goal)
    assert covers(GoalID(id="b", stamp=Time(5)), goal)
    assert not covers(GoalID(id="b"), goal)
    assert not covers(GoalID(stamp=Time(4)), goal)


def test_long_ids_are_shortened_and_stay_apart() -> None:
    assert text_of("a" * 255) == "a" * 255
    long, longer = text_of("a" * 256), text_of("a" * 257)
    assert len(long) == len(longer) == 255
    assert long != longer
