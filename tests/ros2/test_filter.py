"""Filtered topics and proxied services on real ROS 2: what passes, what doesn't, and what if the oracle is away."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.robot import ALLOWED, AWAY, GATE, SIDES, SWITCH, all_but_sevens, done, settled, spec_folder
from tests.ros2.harness import Peer, Scene, Server, eventually

callback_groups = pytest.importorskip("rclpy.callback_groups")
qos = pytest.importorskip("rclpy.qos")
task = pytest.importorskip("rclpy.task")
relay = pytest.importorskip("oracle_ros2.relay")
msg = pytest.importorskip("std_msgs.msg")
geometry = pytest.importorskip("geometry_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")
diagnostic = pytest.importorskip("diagnostic_msgs.msg")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

LOG = """
id: log
description: Points with a stamp, numbers without
streams:
  - topic: /number
    type: std_msgs/msg/Int64
  - topic: /point
    type: geometry_msgs/msg/PointStamped
properties:
  - id: small
    formula: 'not {topic: "/number", data > 1000}'
"""
DENIED = (False, "not now")
INSIDE = """
  - id: inside_after_outside
    formula: '{service: "/inner", kind: request} -> once{service: "/switch", kind: request}'
    guards: [/inner]
"""


def gate(folder: Path, intercept: str = "publisher", unavailable: str = "deny", within: str = "60s") -> Scene:
    return Scene(folder, spec_folder(folder, GATE, intercept=intercept, unavailable=unavailable, within=within))


def values(heard: list[Any]) -> list[int]:
    return [said.data for said in heard]


@pytest.mark.parametrize("intercept", ["publisher", "subscriber"])
def test_a_burst_passes_in_order_but_for_what_is_denied(intercept: str, tmp_path: Path) -> None:
    with gate(tmp_path, intercept) as scene:
        adapter, peer = scene.adapter("gate"), scene.peer()
        source, target = SIDES[intercept]
        heard = peer.record(msg.Int64, target)
        publisher = peer.publisher(msg.Int64, source)
        peer.until(lambda: peer.node.count_publishers(target) == 1)
        numbers = range(1, 1001)
        for number in numbers:
            publisher.publish(msg.Int64(data=number))
        allowed = [number for number in numbers if number % 7]
        peer.until(lambda: values(heard)[-1:] == [1000], "the last of the burst did not come")
        assert values(heard) == allowed
        all_but_sevens(scene.server, 1000)
        adapter.ends_well()
        assert adapter.log.count("denied a message of /number: no_sevens") == len(numbers) - len(allowed)


@pytest.mark.parametrize("away", AWAY)
def test_without_an_oracle_messages_pass_where_the_spec_says_so(away: Callable[[Server], None], tmp_path: Path) -> None:
    with gate(tmp_path, unavailable="pass", within="400ms") as scene:
        adapter, peer = scene.adapter("gate"), scene.peer()
        heard = peer.record(msg.Int64, "/number")
        publisher = peer.publisher(msg.Int64, "/number_mon")
        away(scene.server)
        began = time.monotonic()
        publisher.publish(msg.Int64(data=7))
        publisher.publish(msg.Int64(data=8))
        peer.until(lambda: len(heard) == 2)
        assert time.monotonic() - began >= 0.4
        assert values(heard) == [7, 8]
        adapter.said("passed a message of /number: no (connection|decision)")


def test_without_an_oracle_messages_are_withheld_where_the_spec_says_so(tmp_path: Path) -> None:
    with gate(tmp_path, unavailable="deny", within="400ms") as scene:
        adapter, peer = scene.adapter("gate"), scene.peer()
        heard = peer.record(msg.Int64, "/number")
        publisher = peer.publisher(msg.Int64, "/number_mon")
        scene.server.kill()
        began = time.monotonic()
        publisher.publish(msg.Int64(data=1))
        peer.until(lambda: "denied a message of /number: no connection to the oracle" in adapter.log)
        assert time.monotonic() - began >= 0.4
        scene.server.restart()
        eventually(lambda: adapter.log.count("oracle: attached"), lambda count: count == 2)
        publisher.publish(msg.Int64(data=2))
        peer.until(lambda: heard)
        assert values(heard) == [2]
        first, second = settled(scene.server, 2)
        assert (first["kind"], first["decision"], first["passed"]) == ("unavailable", "allow", False)
        assert (second["kind"], second["decision"], second["passed"]) == ("topic", "allow", True)


def test_a_message_without_a_stamp_is_of_the_time_it_was_published(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, LOG)) as scene:
        scene.adapter("log")
        peer = scene.peer()
        numbers = peer.publisher(msg.Int64, "/number")
        points = peer.publisher(geometry.PointStamped, "/point")
        stamped = geometry.PointStamped()
        stamped.header.stamp.sec, stamped.header.stamp.nanosec = 1_700_000_000, 5
        began = time.time_ns()
        numbers.publish(msg.Int64(data=1))
        points.publish(geometry.PointStamped())
        ended = time.time_ns()
        points.publish(stamped)
        events = eventually(lambda: scene.server.events("s"), lambda found: len(found) == 3)
        [number], (unset, old) = (
            sorted((e for e in events if e["stream"] == name), key=lambda e: e["seq"]) for name in ("/number", "/point")
        )
        for event in (number, unset):
            assert began <= event["stamp"] <= ended
            assert event["stamp"] < event["arrived"]
        assert old["stamp"] == 1_700_000_000 * 10**9 + 5


def served(peer: Peer, callback: Callable[[Any, Any], Any]) -> list[bool]:
    """Serve /switch, and return a list of the requests that reach it."""
    reached: list[bool] = []

    async def serve(request: Any, response: Any) -> Any:
        reached.append(request.data)
        made = callback(request, response)
        return await made if isinstance(made, task.Future) else made

    group = callback_groups.ReentrantCallbackGroup()
    peer.node.create_service(srv.SetBool, "/switch", serve, callback_group=group)
    return reached


def switch(peer: Peer, data: bool) -> tuple[bool, str]:
    answer = peer.call(srv.SetBool, "/switch_mon", srv.SetBool.Request(data=data))
    return answer.success, answer.message


def say(text: str) -> Callable[[Any, Any], Any]:
    return lambda _request, _response: srv.SetBool.Response(success=True, message=text)


def test_a_denied_request_reaches_nobody(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        reached = served(peer, say("on"))
        assert [switch(peer, data) for data in (True, False, True)] == [(True, "on"), DENIED, (True, "on")]
        assert reached == [True, True]
        assert done(settled(scene.server, 5)) == [*ALLOWED, ("request", "deny", False), *ALLOWED]
        adapter.said("denied a request of /switch, call [0-9]+: only_on")
        adapter.ends_well()


def test_a_denied_response_is_not_relayed(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        reached = served(peer, say("nonsense"))
        assert switch(peer, True) == DENIED
        assert reached == [True]
        adapter.said("denied a response of /switch, call [0-9]+: no_nonsense")


def test_a_service_that_is_not_there_is_answered_by_the_denied_response(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        assert switch(peer, True) == DENIED
        adapter.said("/switch is not there: call [0-9]+ is answered by denied_response")
        eventually(lambda: done(scene.server.events("s")), lambda found: found == [("request", "allow", False)])
        served(peer, say("on"))
        assert switch(peer, True) == (True, "on")


def test_without_a_denied_response_a_denied_call_gets_the_defaults_and_the_log_says_so(tmp_path: Path) -> None:
    spec = SWITCH.replace("    denied_response: {success: false, message: not now}\n", "")
    with Scene(tmp_path, spec_folder(tmp_path, spec)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        errors = peer.record(msg.String, "/uav1/monitor_error", 100)
        peer.until(lambda: peer.node.count_publishers("/uav1/monitor_error"))
        served(peer, say("on"))
        assert switch(peer, False) == (False, "")
        adapter.said("a denied call of /switch is answered by the defaults of its type")
        denied = re.compile("denied a request of /switch, call [0-9]+: only_on")
        peer.until(lambda: any(denied.search(error.data) for error in errors))


def test_a_call_that_is_never_answered_holds_up_no_other(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        unanswered = iter([task.Future()])

        def first_never(_request: Any, response: Any) -> Any:
            return next(unanswered, None) or say("on")(None, response)

        reached = served(peer, first_never)
        client = peer.node.create_client(srv.SetBool, "/switch_mon")
        peer.until(client.service_is_ready)
        waiting = client.call_async(srv.SetBool.Request(data=True))
        peer.until(lambda: reached)
        assert switch(peer, True) == (True, "on")
        assert not waiting.done()
        adapter.ends_well()


def test_of_calls_that_a_service_never_answers_the_oldest_is_given_up(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        served(scene.peer("hangs"), say("on"))  # it is never spun
        many = qos.QoSProfile(depth=100 * relay.MOST)  # else later answers take the place of the first one's
        client = peer.node.create_client(srv.SetBool, "/switch_mon", qos_profile=many)
        peer.until(client.service_is_ready)
        first, *_ = [client.call_async(srv.SetBool.Request(data=True)) for _ in range(relay.MOST)]
        peer.until(lambda: client.call_async(srv.SetBool.Request(data=True)) and first.done())
        assert not first.result().success
        adapter.said("/switch has not answered it, nor 1000 that came later: call [0-9]+ is answered by denied")


def test_who_can_call_past_the_monitor_is_told(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        served(peer, say("on"))
        proxied = peer.node.create_client(srv.SetBool, "/switch_mon")
        errors = peer.record(msg.String, "/uav1/monitor_error", 100)
        shown = peer.record(diagnostic.DiagnosticArray, "/diagnostics")
        peer.until(lambda: peer.node.count_publishers("/uav1/monitor_error"))

        def troubles() -> dict[str, str]:
            streams = scene.server.session("s")["monitors"][0]["streams"]
            return {stream["kind"]: stream["trouble"] for stream in streams}

        past = peer.node.create_client(srv.SetBool, "/switch")
        text = "/peer can call /switch past the monitor"
        peer.until(lambda: f"/switch: {text}" in [error.data for error in errors])
        peer.until(lambda: text in [status.message for array in shown for status in array.status])
        eventually(troubles, lambda found: found == {"request": text, "response": ""})
        peer.node.destroy_client(past)
        adapter.said("/switch: recovered")
        beside = peer.node.create_service(srv.SetBool, "/switch_mon", say("on"))
        adapter.said("/switch: /peer serves /switch_mon beside the monitor")
        peer.node.destroy_service(beside)
        eventually(troubles, lambda found: found == {"request": "", "response": ""})
        peer.until(proxied.service_is_ready)
        adapter.ends_well()


def test_calls_at_once_that_call_another_proxied_service_are_all_answered(tmp_path: Path) -> None:
    inner = SWITCH.partition("streams:\n")[2].partition("properties:")[0].replace("/switch", "/inner")
    spec = SWITCH.replace("properties:", f"{inner}properties:") + INSIDE
    with Scene(tmp_path, spec_folder(tmp_path, spec)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        many = qos.QoSProfile(depth=100)  # all at once, as threads of several nodes do
        deeper = peer.node.create_client(srv.SetBool, "/inner_mon", qos_profile=many)

        async def ask_inside(request: Any, _: Any) -> Any:
            return await deeper.call_async(request)

        group = callback_groups.ReentrantCallbackGroup()
        peer.node.create_service(srv.SetBool, "/switch", ask_inside, qos_profile=many, callback_group=group)
        peer.node.create_service(srv.SetBool, "/inner", say("inside"), qos_profile=many, callback_group=group)
        client = peer.node.create_client(srv.SetBool, "/switch_mon", qos_profile=many)
        peer.until(lambda: client.service_is_ready() and deeper.service_is_ready())
        calls = [client.call_async(srv.SetBool.Request(data=number % 5 > 0)) for number in range(50)]
        peer.until(lambda: all(call.done() for call in calls), "not all calls are answered")
        answers = [(call.result().success, call.result().message) for call in calls]
        assert answers == [(True, "inside") if number % 5 else DENIED for number in range(50)]
        passed = [event["passed"] for event in settled(scene.server, 10 + 40 * 4)]
        assert (passed.count(False), passed.count(True)) == (10, 160)
        adapter.ends_well()
