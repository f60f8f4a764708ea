"""An offline monitor on real ROS 2: no oracle, a log that is replayed."""

from __future__ import annotations

import json
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.processes import ROOT, SERVER
from tests.ros2.harness import Scene, eventually

msg = pytest.importorskip("battery_uav_msgs.msg")
srv = pytest.importorskip("battery_uav_msgs.srv")

pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def test_a_log_without_an_oracle_is_replayed(tmp_path: Path) -> None:
    streams, log = tmp_path / "streams.json", tmp_path / "log.jsonl"
    with Scene(tmp_path / "scene") as scene:
        made = scene.run("streams", SERVER, "streams", ROOT / "specs" / "battery_uav.yaml")
        eventually(lambda: made.running, lambda running: not running)
        streams.write_text(made.log)
        peer = scene.peer()
        words = ("--log", log, "--streams", streams, "--monitor", "uav1")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros2", *words)
        adapter.said("observing")
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
        eventually(lambda: len(log.read_text().splitlines()), lambda count: count == 7)
        assert adapter.end(signal.SIGINT) == 0
        replayed = scene.run("replay", SERVER, "replay", ROOT / "specs" / "battery_uav.yaml", log)
        replayed.said("7 events, 1 violations")
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [line["data"]["id"] for line in lines if line["kind"] == "topic"] == [1, 2, 3, 4, 5]
    assert [line["kind"] for line in lines if line["stream"] == "/SetLED"] == ["request", "response"]
    assert len(served) == 1
