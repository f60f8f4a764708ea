"""Quality of service on real ROS 2: everybody is heard and hears, or it is told who isn't."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.processes import PATIENCE
from tests.robot import spec_folder
from tests.ros2.harness import Peer, Scene, eventually

rclpy_qos = pytest.importorskip("rclpy.qos")
serialization = pytest.importorskip("rclpy.serialization")
qos = pytest.importorskip("oracle_ros2.qos")
endpoints = pytest.importorskip("oracle_ros2.endpoints")
republished = pytest.importorskip("oracle_ros2.republished")
msg = pytest.importorskip("std_msgs.msg")
duration = pytest.importorskip("rclpy.duration")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

SPEC = """
id: gate
description: Numbers pass, but for multiples of 7
streams:
  - topic: /number
    type: std_msgs/msg/Int64
    action: filter
    intercept: publisher
    decide_within: 60s
    signals: {seven: msg.data % 7 == 0}
  - topic: /logged
    type: std_msgs/msg/Int64
properties:
  - id: no_sevens
    formula: 'not {topic: "/number", seven}'
    guards: [/number]
"""
RELIABLE, EFFORT = rclpy_qos.ReliabilityPolicy.RELIABLE, rclpy_qos.ReliabilityPolicy.BEST_EFFORT
VOLATILE, LASTING = rclpy_qos.DurabilityPolicy.VOLATILE, rclpy_qos.DurabilityPolicy.TRANSIENT_LOCAL


def profile(reliability: Any = RELIABLE, durability: Any = VOLATILE, depth: int = 10, **more: Any) -> Any:
    return rclpy_qos.QoSProfile(depth=depth, reliability=reliability, durability=durability, **more)


@pytest.fixture
def scene(tmp_path: Path) -> Any:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "gate.yaml").write_text(SPEC, encoding="utf-8")
    with Scene(tmp_path, specs) as scene:
        yield scene


def values(heard: list[Any]) -> list[int]:
    return [said.data for said in heard]


def offers(peer: Peer, topic: str) -> list[tuple[Any, Any]]:
    found = [info.qos_profile for info in peer.node.get_publishers_info_by_topic(topic)]
    return [(offered.reliability, offered.durability) for offered in found]


def test_a_best_effort_publisher_that_comes_later_is_heard_and_forwarded_as_it_is(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    heard = peer.record(msg.Int64, "/number", profile(EFFORT))
    publisher = peer.node.create_publisher(msg.Int64, "/number_mon", profile(EFFORT))
    adapter.said("matching the publishers of /number_mon: best_effort")
    peer.until(lambda: offers(peer, "/number") == [(EFFORT, VOLATILE)], "it is not offered as the original")
    peer.until(lambda: publisher.get_subscription_count() == 1)

    def publish() -> bool:  # not each message of best effort must come
        publisher.publish(msg.Int64(data=5))
        return bool(heard)

    peer.until(publish)
    assert set(values(heard)) == {5}
    assert peer.record(msg.Int64, "/number", profile(RELIABLE)) == []
    adapter.said("/number: /peer can't receive /number: .*reliab")


def test_what_lasts_is_forwarded_to_those_who_come_later(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    publisher = peer.node.create_publisher(msg.Int64, "/number_mon", profile(durability=LASTING, depth=1))
    publisher.publish(msg.Int64(data=1))  # before the adapter has matched
    publisher.publish(msg.Int64(data=2))
    adapter.said("matching the publishers of /number_mon: reliable, transient_local")
    peer.until(lambda: offers(peer, "/number") == [(RELIABLE, LASTING)])
    early = peer.record(msg.Int64, "/number", profile(durability=LASTING))
    peer.until(lambda: 2 in values(early), "what was kept is heard by nobody")
    publisher.publish(msg.Int64(data=3))
    publisher.publish(msg.Int64(data=7))
    eventually(
        lambda: [event["decision"] for event in scene.server.events("s")][-2:], lambda of: of == ["allow", "deny"]
    )
    late = peer.record(msg.Int64, "/number", profile(durability=LASTING))
    peer.until(lambda: late)
    assert values(late) == [3]


def test_what_is_said_once_before_anything_is_matched_is_heard_once_by_all(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    volatile = peer.record(msg.Int64, "/number")
    peer.until(lambda: offers(peer, "/number") == [(RELIABLE, VOLATILE)])
    lasting = peer.record(msg.Int64, "/number", profile(durability=LASTING))
    publisher = peer.publisher(msg.Int64, "/number_mon", qos=profile(durability=LASTING, depth=1))
    publisher.publish(msg.Int64(data=1))
    peer.until(lambda: volatile and lasting, "what was published once is not received")
    peer.until(lambda: offers(peer, "/number") == [(RELIABLE, LASTING)])
    assert (values(volatile), values(lasting)) == ([1], [1])
    adapter.ends_well()


def test_a_reliable_publisher_beside_a_best_effort_one_loses_nothing_while_they_are_matched(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    steady = peer.publisher(msg.Int64, "/logged")
    effort: list[Any] = []
    count = 0

    def publish() -> bool:
        nonlocal count
        count += 1
        steady.publish(msg.Int64(data=count))
        if count == 20:
            effort.append(peer.node.create_publisher(msg.Int64, "/logged", profile(EFFORT)))
        return "matching the publishers of /logged" in adapter.log and count > 100

    peer.until(publish)
    last = count
    events = eventually(lambda: scene.server.events("s"), lambda found: len(found) >= last)
    assert len(events) == last
    counters = scene.server.session("s")["counters"]
    assert (counters["lost"], counters["refused"]) == (0, 0)


def test_a_subscription_goes_once_the_one_in_its_place_has_had_time_however_soon_the_next_look_is(
    scene: Scene,
) -> None:
    peer = scene.peer()
    heard = endpoints.MatchedSubscription(peer.node, msg.Int64, "/here", lambda *_: None)
    peer.publisher(msg.Int64, "/here", qos=profile(EFFORT), listeners=0)
    heard.look()
    heard.look()
    assert len(list(peer.node.subscriptions)) == 2
    eventually(lambda: heard.look() or len(list(peer.node.subscriptions)), lambda count: count == 1)
    heard.stop()


def test_a_held_message_that_can_not_be_published_does_not_hold_up_those_behind_it(scene: Scene) -> None:
    peer = scene.peer()
    received = peer.record(msg.Int64, "/here", profile(durability=LASTING))
    forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/here")
    offered = [profile(durability=LASTING)]
    forwarded.match(offered)  # from now on messages are held
    for message in (object(), msg.Int64(data=1)):
        assert forwarded.publish(message)
    peer.until(lambda: (forwarded.look(offered), received)[1])
    assert values(received) == [1]
    forwarded.stop()


def test_what_only_the_old_subscription_has_got_is_taken_before_what_comes_on_the_new_one(scene: Scene) -> None:
    peer = scene.peer()
    taken: list[int] = []

    def take(message: bytes, _: Any) -> None:
        taken.append(serialization.deserialize_message(message, msg.Int64).data)

    heard = endpoints.MatchedSubscription(peer.node, msg.Int64, "/here", take)
    steady = peer.publisher(msg.Int64, "/here")
    for number in (1, 2):
        steady.publish(msg.Int64(data=number))
    assert steady.wait_for_all_acked(duration.Duration(seconds=PATIENCE))
    peer.publisher(msg.Int64, "/here", qos=profile(EFFORT), listeners=0)
    heard.look()
    new = list(peer.node.subscriptions)[-1]
    steady.publish(msg.Int64(data=3))

    def turn() -> Any:
        with new.handle:
            found = new.handle.take_message(msg.Int64, True)
        return found and new.callback(*found) is None

    eventually(turn, bool)
    assert list(dict.fromkeys(taken)) == [1, 2, 3]  # the last one has come on both
    heard.stop()


def test_a_message_published_past_the_monitor_is_told(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    errors = peer.record(msg.String, "/uav1/monitor_error", 100)
    peer.until(lambda: peer.node.count_publishers("/uav1/monitor_error"))
    past = peer.node.create_publisher(msg.Int64, "/number", 10)
    adapter.said("/number: /peer publishes /number past the monitor")
    peer.until(lambda: any("past the monitor" in error.data for error in errors))

    def told() -> dict[str, tuple[str, str, str]]:
        [monitor] = scene.server.session("s")["monitors"]
        return {s["stream"]: (s["time_source"], s["trouble"], s["bypass"]) for s in monitor["streams"]}

    text = "/peer publishes /number past the monitor"
    past_it = ("middleware", text, text)
    eventually(told, lambda streams: streams == {"/number": past_it, "/logged": ("middleware", "", "")})
    peer.node.destroy_publisher(past)
    adapter.said("/number: recovered")
    eventually(told, lambda streams: not any(trouble or bypass for _, trouble, bypass in streams.values()))


def test_what_the_installed_type_does_not_have_is_told(tmp_path: Path) -> None:
    lacking = "test_msgs/msg/BasicTypes\n    stamp: header.stmp\n    signals: {n: msg.int32_valu + msg.int64_value}\n"
    request = "request: {stamp: at, signals: {r: msg.bol.x}}"
    service = f"  - service: /trigger\n    type: test_msgs/srv/BasicTypes\n    {request}\n"
    specs = spec_folder(tmp_path, SPEC.replace("std_msgs/msg/Int64\nproperties", f"{lacking}{service}properties"))
    with Scene(tmp_path, specs) as scene:
        adapter = scene.adapter("gate")
        told = {
            "/logged": "test_msgs/msg/BasicTypes has no time at `header.stmp`: ordered by middleware instead; "
            "the spec reads msg.int32_valu, which test_msgs/msg/BasicTypes does not have here",
            "/trigger": "the spec reads msg.bol.x, which the request of test_msgs/srv/BasicTypes does not have here; "
            "the request of test_msgs/srv/BasicTypes has no time at `at`: ordered by arrival instead",
        }
        for stream, trouble in told.items():
            adapter.said(f"{stream}: {trouble}")

        def troubles() -> dict[str, str]:
            [monitor] = scene.server.session("s")["monitors"]
            return {s["stream"]: s["trouble"] for s in monitor["streams"] if s["trouble"]}

        eventually(troubles, lambda found: found == told)
        [monitor] = scene.server.session("s")["monitors"]
        sources = {(s["stream"], s["kind"]): s["time_source"] for s in monitor["streams"]}
        assert sources["/trigger", "request"] == "arrival"


def test_a_publisher_of_another_type_is_told(scene: Scene) -> None:
    adapter, peer = scene.adapter("gate"), scene.peer()
    peer.node.create_publisher(msg.String, "/logged", 10)
    adapter.said("/logged: /peer publishes it as std_msgs/msg/String, not as std_msgs/msg/Int64")


@pytest.mark.parametrize(("size", "depth"), [(20_000, 1000), (2_000_000, 100), (6_000_000, 10)])
def test_of_large_messages_few_are_kept_for_who_hangs(size: int, depth: int, scene: Scene) -> None:
    peer = scene.peer()
    forwarded = republished.MatchedPublisher(peer.node, msg.String, "/large")
    heard = peer.record(msg.String, "/large", profile())
    peer.until(lambda: peer.node.count_publishers("/large") == 1)
    for text in ("a" * size, "b"):
        forwarded.publish(bytes(serialization.serialize_message(msg.String(data=text))))
        eventually(lambda: forwarded.look([profile()]), lambda _: forwarded._publishers[0].qos_profile.depth == depth)
    peer.until(lambda: len(heard) == 2)
    assert [len(said.data) for said in heard] == [size, 1]
    forwarded.stop()


@pytest.mark.parametrize(
    ("offered", "heard", "forwarded"),
    [
        ([], (RELIABLE, VOLATILE), (RELIABLE, VOLATILE)),
        ([(RELIABLE, VOLATILE)], (RELIABLE, VOLATILE), (RELIABLE, VOLATILE)),
        ([(EFFORT, VOLATILE)], (EFFORT, VOLATILE), (EFFORT, VOLATILE)),
        ([(RELIABLE, LASTING)], (RELIABLE, LASTING), (RELIABLE, LASTING)),
        ([(EFFORT, VOLATILE), (RELIABLE, LASTING)], (EFFORT, VOLATILE), (RELIABLE, LASTING)),
    ],
)
def test_what_is_asked_for_fits_all_and_what_is_offered_is_what_was(offered: Any, heard: Any, forwarded: Any) -> None:
    profiles = [profile(*one) for one in offered]
    asked, given = qos.to_request(profiles), qos.to_offer(profiles)
    assert (asked.reliability, asked.durability) == heard
    assert (given.reliability, given.durability) == forwarded
    assert all(qos.misfit(one, asked) == "" for one in profiles)


def test_a_deadline_is_forwarded_where_all_keep_the_same() -> None:
    deadline = duration.Duration(nanoseconds=10**8)
    one, other = profile(deadline=deadline), profile()
    assert qos.to_offer([one]).deadline == deadline
    assert qos.same(qos.to_offer([one, one]), qos.to_offer([one]))
    assert qos.same(qos.to_offer([one, other]), qos.to_offer([]))


def test_who_watches_a_lease_sees_that_the_original_has_gone_and_hears_it_again(scene: Scene) -> None:
    peer, robot = scene.peer(), scene.peer("robot")
    watched = profile(liveliness_lease_duration=duration.Duration(seconds=PATIENCE))
    received: list[Any] = []
    watching = robot.node.create_subscription(msg.Int64, "/here", received.append, watched)
    forwarded = republished.MatchedPublisher(peer.node, msg.Int64, "/here")

    def connected(sources: list[str]) -> int:
        forwarded.look([watched] * len(sources), sources)
        return int(watching.get_publisher_count())

    robot.until(lambda: connected(["a"]) == 1, "it is not connected")
    robot.until(lambda: connected([]) == 0, "the lease is kept for one that has gone")
    forwarded.match([watched], ["b"])
    forwarded.publish(msg.Int64(data=1), "b")
    robot.until(lambda: connected(["b"]) and received, "it does not pass")
    forwarded.stop()
