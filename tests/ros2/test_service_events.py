"""The events of a service, observed live as the messages of a topic: nobody has to use a proxy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.ros2.harness import Scene, eventually

srv = pytest.importorskip("battery_uav_msgs.srv")
introspection = pytest.importorskip("rclpy.service_introspection")
qos = pytest.importorskip("rclpy.qos")

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

SPEC = """
id: lights
ordering: {by: arrival}
streams:
  - topic: /SetLED/_service_event
    type: battery_uav_msgs/srv/SetLED_Event
    stamp: info.stamp
    signals:
      asked: size(msg.request) > 0
      id: "size(msg.request) > 0 ? msg.request[0].id : msg.response[0].id"
properties:
  - {id: small, formula: '{asked} -> {id <= 5}'}
"""
IDS = (3, 4, 9)


def test_calls_are_judged_by_the_events_of_their_service(tmp_path: Path) -> None:
    (tmp_path / "specs").mkdir()
    (tmp_path / "specs" / "lights.yaml").write_text(SPEC)
    with Scene(tmp_path / "scene", tmp_path / "specs") as scene:
        peer = scene.peer()

        def answer(request: Any, response: Any) -> Any:
            response.success, response.id = True, request.id
            return response

        service = peer.node.create_service(srv.SetLED, "/SetLED", answer)
        contents = introspection.ServiceIntrospectionState.CONTENTS
        service.configure_introspection(peer.node.get_clock(), qos.QoSProfile(depth=100), contents)
        adapter = scene.adapter("lights")
        topic = "/SetLED/_service_event"
        peer.until(lambda: peer.node.count_subscribers(topic), "the adapter does not hear the events")
        for number in IDS:
            assert peer.call(srv.SetLED, "/SetLED", srv.SetLED.Request(id=number, status=1)).success
        rows = eventually(lambda: scene.server.records("s"), lambda found: len(found) == 2 * len(IDS))
        adapter.ends_well()
    assert [row["outcome"] for row in rows].count("currently_false") == 1
    assert not any(row["outcome"] == "unknown" for row in rows)
