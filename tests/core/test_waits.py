"""What held events waited for: the stream whose advance or end released each, or those that were behind it still."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from oracle_server.core.events import Source, StreamKey
from oracle_server.core.ordering.reorder import Released, ReorderBuffer

A, B = StreamKey("/a", "topic"), StreamKey("/b", "topic")
ROBOT_A, ROBOT_B, ARM_B = ("robot", A), ("robot", B), ("arm", B)
SOURCES = (ROBOT_A, ROBOT_B, ARM_B)


def opened(max_delay: int | None = None, capacity: int = 1_000) -> ReorderBuffer[int]:
    buffer: ReorderBuffer[int] = ReorderBuffer(max_delay, capacity)
    buffer.open("robot", (A, B))
    buffer.open("arm", (B,))
    return buffer


def waits(released: list[Released[int]]) -> list[tuple[int, str, tuple[Source, ...]]]:
    return [(each.item, each.why, each.waited) for each in released]


def test_the_last_stream_of_the_last_monitor_is_told() -> None:
    buffer = opened()
    assert buffer.push(1, ROBOT_A, "", 10, 0) == []
    assert buffer.clock((ROBOT_B, 20)) == []
    assert waits(buffer.push(2, ARM_B, "", 30, 0)) == [(1, "clock", (ARM_B,))], "not what came to release it"
    assert waits(buffer.clock((ROBOT_A, 40))) == []
    assert waits(buffer.push(3, ROBOT_B, "", 50, 0)) == [(2, "clock", (ROBOT_B,))]


def test_a_clock_is_the_reason_only_where_no_message_tells_as_much() -> None:
    buffer = opened()
    buffer.push(1, ROBOT_B, "", 10, 0)
    assert buffer.push(2, ROBOT_A, "", 10, 0) == []
    buffer.clock((ROBOT_B, 20))
    told = [(1, "frontier", (ARM_B,)), (2, "frontier", (ARM_B,))]
    assert waits(buffer.push(3, ARM_B, "", 10, 0)) == [*told, (3, "frontier", ())], "each has a message of that time"
    assert buffer.push(4, ROBOT_A, "", 11, 0) == []
    assert waits(buffer.push(5, ARM_B, "", 11, 0)) == [(4, "clock", (ARM_B,)), (5, "clock", ())]


def test_what_is_due_as_it_comes_waited_for_nothing() -> None:
    buffer = opened()
    buffer.clock((ROBOT_B, 50))
    buffer.clock((ARM_B, 50))
    assert waits(buffer.push(1, ROBOT_A, "", 10, 0)) == [(1, "clock", ())]
    assert waits(buffer.push(2, ROBOT_A, "", 20, 0)) == [(2, "clock", ())]
    assert waits(buffer.push(3, ROBOT_A, "", 5, 0)) == [(3, "clock", ())], "it is late"


def test_a_monitor_that_leaves_is_told_of_what_waited_for_it_only() -> None:
    buffer = opened()
    buffer.push(1, ROBOT_A, "", 10, 0)
    buffer.push(2, ROBOT_A, "", 30, 0)
    buffer.clock((ARM_B, 20))
    assert waits(buffer.clock((ROBOT_B, 40))) == [(1, "clock", (ROBOT_B,))]
    assert waits(buffer.close("arm")) == [(2, "clock", (ARM_B,))]
    buffer.push(3, ROBOT_A, "", 60, 0)
    assert waits(buffer.close("robot")) == [(3, "frontier", (ROBOT_B,))]


def test_of_what_is_told_at_once_each_stream_was_waited_for_that_was_behind() -> None:
    buffer = opened()
    buffer.clock((ROBOT_B, 15))
    buffer.push(1, ROBOT_A, "", 10, 0)
    buffer.push(2, ROBOT_A, "", 20, 0)
    told = buffer.clock((ARM_B, 30), (ROBOT_B, 30), (("stranger", A), 5))
    assert waits(told) == [(1, "clock", (ARM_B,)), (2, "clock", (ARM_B, ROBOT_B))]


@given(
    st.lists(st.tuples(st.sampled_from(SOURCES), st.integers(0, 9)), max_size=8),
    st.lists(st.tuples(st.sampled_from(SOURCES), st.integers(0, 9)), max_size=6),
)
def test_what_is_told_at_once_releases_as_what_is_told_one_by_one(
    pushed: list[tuple[Source, int]], told: list[tuple[Source, int]]
) -> None:
    together, apart = opened(), opened()
    for number, (source, stamp) in enumerate(pushed):
        together.push(number, source, "", stamp, 0)
        apart.push(number, source, "", stamp, 0)
    released = [each for clock in told for each in apart.clock(clock)]
    assert [w[:2] for w in waits(together.clock(*told))] == [w[:2] for w in waits(released)]
    assert (together.limit, together.awaited) == (apart.limit, apart.awaited)


def test_a_wait_that_is_given_up_tells_all_that_were_behind() -> None:
    buffer = opened(max_delay=5, capacity=1)
    buffer.push(1, ROBOT_A, "", 10, 0)
    buffer.clock((ARM_B, 20))
    assert waits(buffer.advance(5)) == [(1, "max_delay", (ROBOT_B,))]
    buffer.push(2, ROBOT_A, "", 30, 6)
    assert waits(buffer.push(3, ROBOT_A, "", 40, 6)) == [(2, "capacity", (ARM_B, ROBOT_B))]


def test_a_new_publisher_of_a_stream_is_waited_for_under_its_name() -> None:
    buffer: ReorderBuffer[int] = ReorderBuffer(None, 1_000)
    buffer.open("robot", (A,))
    assert waits(buffer.push(1, ROBOT_A, "one", 10, 0)) == [(1, "frontier", ())]
    assert waits(buffer.push(2, ROBOT_A, "two", 10, 0)) == [(2, "frontier", ())]
    assert buffer.push(3, ROBOT_A, "one", 20, 0) == []
    assert waits(buffer.push(4, ROBOT_A, "two", 30, 0)) == [(3, "frontier", (ROBOT_A,))]


ACT = st.tuples(st.sampled_from("psccx"), st.sampled_from(SOURCES), st.sampled_from("uv"), st.integers(0, 9))


@settings(max_examples=300, deadline=None)
@given(st.lists(ACT))
def test_it_is_who_was_behind_before_and_not_any_more(acts: list[tuple[str, Source, str, int]]) -> None:
    buffer, stamps, newest = opened(max_delay=30), list[int](), dict[tuple[Source, str], int]()
    for now, (act, source, publisher, more) in enumerate(acts):
        before, came = buffer.frontiers, len(stamps)
        released = buffer.advance(now)
        for each in released:
            assert each.why == "max_delay"
            assert set(each.waited) == {s for s, at in before.items() if at is None or at < stamps[each.item]}
        if act in "ps":
            newest[source, publisher] = newest.get((source, publisher), 0) + more
            stamps.append(newest[source, publisher])
            released = buffer.push(came, source, publisher, stamps[came], now)
        elif act == "c":
            released = buffer.clock((source, now + more))
        else:
            released = buffer.close(source[0])
        after = buffer.frontiers
        for each in released:
            stamp, told = stamps[each.item], set(each.waited)
            over = {s for s, at in before.items() if at is None or at < stamp}
            over -= {s for s, at in after.items() if at is None or at < stamp}
            assert told == (set() if each.item == came else over)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.tuples(st.booleans(), st.sampled_from(SOURCES), st.integers(1, 9)), max_size=40), st.integers(1, 9))
def test_what_is_released_in_turns_waited_for_the_same(acts: list[tuple[bool, Source, int]], every: int) -> None:
    """Also where others have advanced meanwhile."""
    at_once, in_turns = opened(), opened()
    in_turns.most = 1
    found: list[dict[int, tuple[Source, ...]]] = [{}, {}]
    newest: dict[Source, int] = {}
    for number, (pushes, source, more) in enumerate(acts):
        stamp = newest[source] = newest.get(source, 0) + more
        for buffer, told in zip((at_once, in_turns), found, strict=True):
            did = buffer.push(number, source, "", stamp, 0) if pushes else buffer.clock((source, stamp))
            while number % every == 0 and buffer.due is not None:
                did += buffer.more()
            told.update({each.item: each.waited for each in did})
    while in_turns.due is not None:
        found[1].update({each.item: each.waited for each in in_turns.more()})
    assert found[0] == found[1]
