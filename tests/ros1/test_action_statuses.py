"""How an action's goals stand, as clients are to see it: without nodes."""

from __future__ import annotations

import io
from collections.abc import Sequence

import pytest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from oracle_ros1 import actionstatus, statusarray
from oracle_ros1.actionmessages import covers, text_of
from oracle_ros1.actionstatus import LAG, SHOWN, Statuses, accepted, status, word
from oracle_ros1.statusarray import ArrayReader, StatusArray
from rospy import AnyMsg, Time
from std_msgs.msg import Header

ACTIVE, SUCCEEDED, ABORTED, REJECTED = (
    GoalStatus.ACTIVE, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.REJECTED
)  # fmt: skip


def sent(*entries: GoalStatus) -> AnyMsg:
    """An array as it comes."""
    written = io.BytesIO()
    GoalStatusArray(Header(7, Time(8, 9), "map"), list(entries)).serialize(written)
    return came(written.getvalue())


def came(serialized: bytes) -> AnyMsg:
    message = AnyMsg().deserialize(serialized)
    message._connection_header = {"type": "actionlib_msgs/GoalStatusArray"}
    return message


def decoded(message: AnyMsg | None) -> GoalStatusArray:
    assert message is not None
    return GoalStatusArray().deserialize(message._buff)


def array(**codes: int) -> StatusArray:
    return ArrayReader().read(sent(*(GoalStatus(GoalID(id=goal), code, "") for goal, code in codes.items())))


def said_by(node: str, **codes: int) -> StatusArray:
    message = sent(*(GoalStatus(GoalID(id=goal), code, "") for goal, code in codes.items()))
    message._connection_header = {**message._connection_header, "callerid": node}
    return ArrayReader().read(message)


def seen(statuses: Statuses, now: float) -> dict[str, int]:
    return {entry.goal_id.id: entry.status for entry in decoded(statuses.view(now)).status_list}


def test_changes_are_the_difference_to_the_last_array() -> None:
    statuses = Statuses()
    assert statuses.changes(array(a=ACTIVE, b=ACTIVE)) == [("a", ACTIVE), ("b", ACTIVE)]
    assert statuses.changes(array(a=ACTIVE, b=SUCCEEDED)) == [("b", SUCCEEDED)]
    assert statuses.changes(array(b=SUCCEEDED)) == []
    assert statuses.changes(array(a=ACTIVE)) == [("a", ACTIVE)]


def test_each_of_two_servers_of_an_action_has_its_own_last_array() -> None:
    statuses = Statuses()
    assert statuses.changes(said_by("/one", a=ACTIVE, b=ACTIVE)) == [("a", ACTIVE), ("b", ACTIVE)]
    assert statuses.changes(said_by("/two", b=SUCCEEDED)) == [("b", SUCCEEDED)]
    assert statuses.changes(said_by("/one", a=ACTIVE, b=ACTIVE)) == []
    assert statuses.changes(said_by("/two", b=SUCCEEDED)) == []


def test_of_servers_that_come_and_go_the_last_ones_are_remembered() -> None:
    statuses = Statuses()
    for number in range(actionstatus._SERVERS + 1):
        assert statuses.changes(said_by(f"/server{number}", a=ACTIVE)) == [("a", ACTIVE)]
    assert len(statuses._codes) == actionstatus._SERVERS
    assert statuses.changes(said_by("/server1", a=ACTIVE)) == []
    assert statuses.changes(said_by("/server0", a=ACTIVE)) == [("a", ACTIVE)]


def test_what_a_server_kept_is_where_its_statuses_begin() -> None:
    statuses = Statuses()
    assert statuses.changes(array(a=ACTIVE, b=ACTIVE), {"a": ACTIVE}) == [("b", ACTIVE)]
    assert statuses.changes(array(a=SUCCEEDED), {"a": SUCCEEDED}) == [("a", SUCCEEDED)]


def test_an_array_to_which_nothing_is_added_is_shown_as_it_is() -> None:
    statuses = Statuses()
    assert statuses.view(0) is None
    same = array(a=ACTIVE)
    statuses.changes(same)
    assert statuses.view(0) is same.message
    statuses.give(status(GoalID(id="x"), REJECTED, "denied"), 0)
    assert statuses.view(SHOWN - 1) is not same.message
    assert statuses.view(SHOWN + 1) is same.message


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


def test_a_goal_by_the_id_of_one_that_was_refused_has_its_own_status() -> None:
    statuses = Statuses()
    statuses.give(status(GoalID(id="a"), REJECTED, "denied"), 0)
    statuses.renew("a")
    assert statuses.changes(array(a=ACTIVE)) == [("a", ACTIVE)]
    assert seen(statuses, 0) == {"a": ACTIVE}


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


def long_array(count: int, changing: int = ACTIVE) -> list[GoalStatus]:
    """Statuses of so many goals, of which one changes."""
    made = [GoalStatus(GoalID(Time(n, n), f"/node-{n}-ü"), n % 10, n * "text ") for n in range(count)]
    made[count // 2].status = changing
    return made


@pytest.mark.parametrize("count", [1, 2, 200])
def test_an_array_is_read_as_genpy_reads_it(count: int) -> None:
    wanted = long_array(count)
    read = ArrayReader().read(sent(*wanted))
    assert [(one.goal_id, one.code) for one in read.entries] == [(one.goal_id, one.status) for one in wanted]
    assert read.header == Header(7, Time(8, 9), "map")


def test_only_what_is_new_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[bytes] = []

    class Counting(GoalStatus):  # type: ignore[misc]
        def deserialize(self, serialized: bytes) -> GoalStatus:
            counted.append(serialized)
            return super().deserialize(serialized)

    monkeypatch.setattr(statusarray, "GoalStatus", Counting)
    reader = ArrayReader()
    reader.read(sent(*long_array(200)))
    assert len(counted) == 200
    reader.read(sent(*long_array(200)))
    reader.read(sent(*long_array(200)[50:]))  # some have expired
    assert len(counted) == 200
    read = reader.read(sent(*long_array(200, SUCCEEDED)[50:]))
    assert len(counted) == 201
    assert read.entries[50].code == SUCCEEDED


def shown(read: StatusArray, denied: Sequence[str]) -> AnyMsg:
    """What clients see of an array in which the proxy has rejected some goals, and one more."""
    statuses = Statuses()
    statuses.changes(read)
    for goal in (*denied, "new"):
        statuses.give(status(GoalID(Time(1), goal), REJECTED, f"denied: {goal}"), 0)
    return statuses.view(0)


def test_beside_denied_goals_all_else_is_byte_for_byte_what_came() -> None:
    wanted = long_array(200)
    read = ArrayReader().read(sent(*wanted))
    denied = wanted[3].goal_id.id
    made = shown(read, [denied])
    assert made._connection_header == read.message._connection_header
    for place, goal in ((3, denied), (200, "new")):
        wanted[place : place + 1] = [GoalStatus(GoalID(Time(1), goal), REJECTED, f"denied: {goal}")]
    assert made._buff == sent(*wanted)._buff


@pytest.mark.parametrize("missing", [1, 30, 4000])
def test_what_is_cut_off_is_not_read(missing: int) -> None:
    whole = sent(*long_array(30))._buff
    with pytest.raises(Exception, match=r"."):
        ArrayReader().read(came(whole[:-missing]))


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
