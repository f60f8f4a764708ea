"""Arrays of goals' statuses, read as they are serialized, beside what rclpy reads in them."""

from __future__ import annotations

import random
import subprocess
import sys
import textwrap

import pytest

action_msgs = pytest.importorskip("action_msgs.msg")
serialization = pytest.importorskip("rclpy.serialization")
statuses = pytest.importorskip("oracle_ros2.statuses")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def array(count: int, seed: int = 0) -> bytes:
    """Of so many goals."""
    chance = random.Random(seed)
    message = action_msgs.GoalStatusArray()
    for _ in range(count):
        one = action_msgs.GoalStatus(status=chance.randrange(7))
        one.goal_info.goal_id.uuid = list(chance.randbytes(16))
        one.goal_info.stamp.sec, one.goal_info.stamp.nanosec = chance.randrange(2**31), chance.randrange(10**9)
        message.status_list.append(one)
    return bytes(serialization.serialize_message(message))


def decoded(serialized: bytes) -> list[tuple[bytes, int]]:
    message = serialization.deserialize_message(serialized, action_msgs.GoalStatusArray)
    return [(bytes(one.goal_info.goal_id.uuid), one.status) for one in message.status_list]


@pytest.mark.parametrize("count", [1, 2, 3, 7, 200])
def test_an_array_is_read_as_rclpy_reads_it(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    serialized = array(count)
    wanted = decoded(serialized)
    monkeypatch.setattr(statuses, "_decoded", lambda _: pytest.fail("it was deserialized"))
    assert list(statuses.read(serialized).items()) == wanted
    assert statuses.read(serialized + b"\x00") == dict(wanted), "as a middleware may fill it up"


def test_what_is_no_such_array_is_read_by_rclpy_alone() -> None:
    big = array(2)
    with pytest.raises(Exception, match=r"."):
        statuses.read(big[:30])
    big_endian = b"\x00\x00" + big[2:4] + (0).to_bytes(4, "big")
    assert statuses.read(big_endian) == {}
    assert statuses.read(array(0)) == {}


def test_entries_are_changed_and_left_out() -> None:
    serialized = array(3)
    (first, _), (second, status), (third, _) = decoded(serialized)
    made = statuses.changed(serialized, {first: None, third: statuses.ABORTED}.get)
    assert decoded(made) == [(second, status), (third, statuses.ABORTED)]
    ended = statuses.changed(serialized, {second: statuses.ABORTED}.get)
    assert [(goal, now) for goal, now in decoded(ended) if goal == second] == [(second, statuses.ABORTED)]
    assert len(decoded(ended)) == len(decoded(serialized))
    assert statuses.changed(serialized, lambda _, now: now) == serialized


def test_a_transition_is_told_once_and_each_publisher_has_its_own() -> None:
    seen = statuses.Transitions()
    a, b = b"a" * 16, b"b" * 16
    assert seen.of("server", {a: 1}) == [(a, 1)]
    assert seen.of("server", {a: 1, b: 1}) == [(b, 1)]
    assert seen.of("server", {a: 2, b: 1}) == [(a, 2)]
    assert seen.of("other", {b: 4}) == [(b, 4)]
    assert seen.of("server", {b: 4}) == [(b, 4)], "and a goal that expired is no transition"
    seen.keep(["other"])
    assert (seen.knows("server"), seen.knows("other")) == (False, True)


@pytest.mark.parametrize("number", range(-1, 9))
def test_each_status_has_a_word(number: int) -> None:
    assert statuses.word(number) in statuses.WORDS


# In a process of its own, as the tests here make no node.
MANY = """
    from types import SimpleNamespace
    import rclpy
    from oracle_ros2.goals import Goals
    from oracle_ros2.shared import Shared
    from oracle_ros2.standing import HELD, RelayedStatus
    from tests.ros2.test_statuses import array, statuses

    rclpy.init()
    told = []
    link = SimpleNamespace(send=lambda *event, goal_id, lost, **more: told.append((bytes.fromhex(goal_id), lost)))
    goals, stream = Goals(), {"name": "/fib", "kind": "status", "latency": 0}
    goals.begin(b"whose reply is d", 1)
    topics = "/fib/_action/status", "/fib_mon/_action/status"
    relayed = RelayedStatus(Shared(rclpy.create_node("many"), link, None, {}, None), "/fib", stream, topics, goals)
    arrays = [array(1, seed) for seed in range(2 * HELD + 1)]
    for one in arrays:
        relayed._take(one, {"source_timestamp": 2**62})
    relayed.flush()
    print(told == [(goal, 0) for one in arrays for goal in statuses.read(one)])
"""


def test_however_many_arrays_come_while_a_reply_is_due_each_is_told() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(MANY)], capture_output=True, text=True, timeout=100, check=False
    )
    assert ended.stdout.split() == ["True"], ended.stderr
