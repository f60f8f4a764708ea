"""An offline monitor on real ROS 1: no oracle, a log that is replayed."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.offline import logged, logging, replayed
from tests.ros1.harness import Scene

msg = pytest.importorskip("battery_uav_msgs.msg")


def test_a_log_without_an_oracle_is_replayed(tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    with Scene(tmp_path / "scene") as scene:
        adapter, peer = logging(scene, "oracle_ros1", log), scene.peer()
        peer.advertise(msg.BatteryPercentage, "/battery_percentage")
        said = [msg.BatteryPercentage(id=number, percentage=100.0 - number) for number in range(1, 6)]
        peer.publish("/battery_percentage", *said)
        lines = logged(adapter, log, 5)
        replayed(scene, log).said("5 events, 0 violations")
    assert [(line["stream"], line["data"]["id"], line["data"]["percentage"]) for line in lines] == [
        ("/battery_percentage", number, 100.0 - number) for number in range(1, 6)
    ]
