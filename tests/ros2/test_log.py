"""An offline monitor on real ROS 2: no oracle, a log that is replayed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.offline import logged, logging, replayed
from tests.ros2.harness import Scene

msg = pytest.importorskip("battery_uav_msgs.msg")
srv = pytest.importorskip("battery_uav_msgs.srv")

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def test_a_log_without_an_oracle_is_replayed(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    with Scene(tmp_path / "scene") as scene:
        adapter, peer = logging(scene, "oracle_ros2", log), scene.peer()
        served = []

        def answer(request: Any, response: Any) -> Any:
            served.append(request)
            response.success, response.id = True, request.id
            return response

        peer.node.create_service(srv.SetLED, "/SetLED", answer)
        publisher = peer.publisher(msg.BatteryPercentage, "/battery_percentage")
        for number in range(1, 6):
            publisher.publish(msg.BatteryPercentage(id=number, percentage=100.0 - number))
        request = srv.SetLED.Request(id=3, status=1)
        assert peer.call(srv.SetLED, "/SetLED_mon", request).success, "a filtered service passes without an oracle"
        lines = logged(adapter, log, 7)
        replayed(scene, log).said("7 events, 1 violation")
    assert [line["data"]["id"] for line in lines if line["kind"] == "topic"] == [1, 2, 3, 4, 5]
    assert [line["kind"] for line in lines if line["stream"] == "/SetLED"] == ["request", "response"]
    assert len(served) == 1
