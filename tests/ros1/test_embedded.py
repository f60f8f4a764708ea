"""An oracle in the adapter's own process, on real ROS 1: what passes and what doesn't."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from std_msgs.msg import Int64

from tests.processes import beside_server
from tests.robot import GATE, spec_folder
from tests.ros1.harness import Scene


def test_a_filtered_topic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = beside_server()
    if not settings:
        pytest.skip("the server is not installed for this Python")
    monkeypatch.setenv("PYTHONPATH", settings["PYTHONPATH"])
    gate = spec_folder(tmp_path, GATE, intercept="publisher", unavailable="deny", within="60s")
    with Scene(tmp_path, gate) as scene:
        words = ("--embedded", gate / "spec.yaml", "--data", tmp_path / "own")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        adapter.said("observing")
        speaker, hearer = scene.peer(), scene.peer()
        hearer.record(Int64, "/number", speakers=1)
        speaker.advertise(Int64, "/number_mon")
        speaker.publish("/number_mon", *(Int64(data=number) for number in range(1, 101)))
        allowed = [number for number in range(1, 101) if number % 7]
        assert [said.data for said in hearer.heard("/number", len(allowed))] == allowed
        adapter.ends_well()
