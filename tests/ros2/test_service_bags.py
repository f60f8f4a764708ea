"""A service's own events, as real nodes publish them, are its calls where a bag has them."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from tests.processes import ROOT, SERVER
from tests.ros2.harness import Scene

srv = pytest.importorskip("battery_uav_msgs.srv")
introspection = pytest.importorskip("rclpy.service_introspection")
qos = pytest.importorskip("rclpy.qos")

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

DEFINITION = (ROOT / "examples/battery_uav/ros2/battery_uav_msgs/srv/SetLED.srv").read_text(encoding="utf-8")
IDS = (3, 4, 9)
SPEC = """
id: lights
ordering: {by: arrival}
streams:
  - service: /SetLED
    type: battery_uav_msgs/srv/SetLED
    action: log
    request: {signals: {id: msg.id}}
    response: {signals: {id: msg.id, success: msg.success}}
properties:
  - {id: small, formula: '{kind: "request"} -> {id <= 5}'}
  - id: answers
    formula: 'forall[c, i]. {kind: "response", call: *c, id: *i} -> once {kind: "request", call: *c, id: *i}'
"""


def called(folder: Path) -> list[bytes]:
    """The service events of some calls, as they are sent."""
    heard: list[bytes] = []
    with Scene(folder) as scene:
        peer = scene.peer()

        def answer(request: Any, response: Any) -> Any:
            response.success, response.id = True, request.id
            return response

        service = peer.node.create_service(srv.SetLED, "/SetLED", answer)
        profile = qos.QoSProfile(depth=100)
        service.configure_introspection(
            peer.node.get_clock(), profile, introspection.ServiceIntrospectionState.CONTENTS
        )
        topic = "/SetLED/_service_event"
        peer.node.create_subscription(srv.SetLED.Event, topic, heard.append, profile, raw=True)
        peer.until(lambda: peer.node.count_publishers(topic), "the service has no events")
        for number in IDS:
            assert peer.call(srv.SetLED, "/SetLED", srv.SetLED.Request(id=number, status=1)).success
        peer.until(lambda: len(heard) >= 2 * len(IDS), "events are missing")
    return heard


@pytest.mark.parametrize("storage", list(StoragePlugin))
def test_calls_of_a_real_service_are_judged_from_a_bag(storage: StoragePlugin, tmp_path: Path) -> None:
    (tmp_path / "spec.yaml").write_text(SPEC)
    heard = called(tmp_path / "scene")
    with Writer(tmp_path / "bag", version=9, storage_plugin=storage) as writer:
        kind, definition = "battery_uav_msgs/srv/SetLED_Event", {"msgdef": DEFINITION, "rihs01": "RIHS01_00"}
        events = writer.add_connection("/SetLED/_service_event", kind, **definition)
        for message in heard:
            writer.write(events, time.time_ns(), message)
    with Scene(tmp_path / "judging") as scene:
        replay = scene.run("replay", SERVER, "replay", "--json", "--strict", tmp_path / "spec.yaml", tmp_path / "bag")
        assert replay.wait() == 1
        last = next(line for line in replay.log.splitlines() if line.startswith('{"summary"'))
    summary = json.loads(last)["summary"]
    assert summary["events"] == 2 * len(IDS)
    assert {name: state["violations"] for name, state in summary["properties"].items()} == {"small": 1, "answers": 0}
    assert summary["notes"] == []
