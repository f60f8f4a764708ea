"""A topic that nobody publishes on real ROS 2, as where the spec misspells it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from oracle_adapter import unpublished
from oracle_ros2.unserved import UnservedAction, UnservedService

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")
action_msgs = pytest.importorskip("action_msgs.msg")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

MISSPELT = """
id: misspelt
streams:
  - topic: /estops
    type: std_msgs/msg/Bool
    signals: {pressed: msg.data}
properties:
  - {id: never_pressed, formula: 'not {pressed}'}
"""


def test_it_is_told_with_what_it_is_called_here(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, MISSPELT)) as scene:
        adapter, peer = scene.adapter("misspelt"), scene.peer()
        peer.node.create_publisher(msg.String, "/estop_s", 10)  # of another type
        peer.node.create_publisher(msg.Bool, "/estop", 10)
        text = "nobody publishes /estops; did you mean /estop?"
        adapter.said(re.escape(f"/estops: {text}"))
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]], [text].__eq__
        )
        peer.publisher(msg.Bool, "/estops")
        adapter.said("/estops: recovered")


FILTERED = """
id: filtered
streams:
  - {topic: /cmd, type: std_msgs/msg/Bool, action: filter, intercept: publisher}
properties:
  - {id: stopped, formula: 'not {topic: /cmd, data: true}', guards: [/cmd]}
"""


def test_it_is_told_also_where_nobody_hears_what_passes(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, FILTERED)) as scene:
        adapter, recorder = scene.adapter("filtered"), scene.peer("recorder")
        recorder.record(msg.Bool, "/cmd_mon")
        unheard = "nobody hears /cmd, and past the monitor hears /cmd_mon: /recorder"
        adapter.said(re.escape(f"/cmd: {unheard}; nobody publishes /cmd_mon"))


SERVICE = """
id: lamp
streams:
  - {service: /SetLamp, type: std_srvs/srv/SetBool}
properties:
  - {id: never_on, formula: 'not {kind: request, data: true}'}
"""


def test_a_service_that_nobody_serves_is_told_with_what_it_is_called_here(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SERVICE)) as scene:
        adapter, peer = scene.adapter("lamp"), scene.peer()
        peer.node.create_client(srv.SetBool, "/setlamp")
        peer.node.create_service(srv.Trigger, "/SetLamps", lambda _, response: response)  # of another type
        peer.node.create_service(srv.SetBool, "/set_lamp", lambda _, response: response)
        text = "nobody serves /SetLamp; did you mean /set_lamp?"
        adapter.said(re.escape(f"/SetLamp: {text}"))
        eventually(
            lambda: [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]],
            lambda troubles: text in troubles,
        )
        peer.node.create_service(srv.SetBool, "/SetLamp", lambda _, response: response)
        adapter.said("/SetLamp: recovered")


def known(node: Any) -> set[str]:
    """The services on the graph, once it knows both nodes of the name."""
    twice = node.get_node_names().count("uav1") == 2
    return {name for name, _ in node.get_service_names_and_types()} if twice else set()


def test_where_another_node_has_its_name_a_monitor_does_not_name_its_own_proxy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(unpublished, "PATIENCE", 0.0)
    with Scene(tmp_path) as scene:
        both = scene.peer("uav1").node, scene.peer("uav1").node
        peer = scene.peer()
        for number, node in enumerate(both):
            node.create_service(srv.SetBool, f"/SetLamp_{number}", lambda _, response: response)
        for node in both:
            peer.until(lambda node=node: known(node) >= {"/SetLamp_0", "/SetLamp_1"})
        told = dict(both[0].get_service_names_and_types_by_node("uav1", "/"))
        mine = 0 if "/SetLamp_1" in told else 1  # the graph tells of the other one
        unserved = UnservedService(both[mine], "/SetLamp", "std_srvs/srv/SetBool")
        assert unserved.look() == f"nobody serves /SetLamp; did you mean /SetLamp_{1 - mine}?"


def test_the_proxy_of_another_monitor_is_not_what_was_meant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As of one that was killed, which DDS still has."""
    monkeypatch.setattr(unpublished, "PATIENCE", 0.0)
    with Scene(tmp_path) as scene:
        scene.peer("uav2").node.create_publisher(action_msgs.GoalStatusArray, "/go_mon/_action/status", 1)
        peer = scene.peer("uav1")
        peer.until(lambda: peer.node.count_publishers("/go_mon/_action/status"))
        assert UnservedAction(peer.node, "/go", "/go_mon").look() == "nobody serves /go"
        assert UnservedAction(peer.node, "/go").look() == "nobody serves /go; did you mean /go_mon?"
