"""An offline monitor on real ROS 1: no oracle, a log that is replayed."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path

import pytest

from tests.processes import ROOT, SERVER, eventually
from tests.ros1.harness import Scene

msg = pytest.importorskip("battery_uav_msgs.msg")


def test_a_log_without_an_oracle_is_replayed(tmp_path: Path) -> None:
    streams, log = tmp_path / "streams.json", tmp_path / "log.jsonl"
    with Scene(tmp_path / "scene") as scene:
        made = scene.run("streams", SERVER, "streams", ROOT / "specs" / "battery_uav.yaml")
        eventually(lambda: made.running, lambda running: not running)
        streams.write_text(made.log)
        words = ("--log", log, "--streams", streams, "--monitor", "uav1")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        adapter.said("observing")
        message = "{id: 7, percentage: 93.5}"
        kind = "battery_uav_msgs/BatteryPercentage"
        scene.run("publisher", "rostopic", "pub", "-r", "10", "/battery_percentage", kind, message)
        eventually(lambda: len(log.read_text().splitlines()), lambda count: count >= 5)
        assert adapter.end(signal.SIGINT) == 0
        replayed = scene.run("replay", SERVER, "replay", ROOT / "specs" / "battery_uav.yaml", log)
        replayed.said(" events, 0 violations")
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert {(line["stream"], line["data"]["id"], line["data"]["percentage"]) for line in lines} == {
        ("/battery_percentage", 7, 93.5)
    }
