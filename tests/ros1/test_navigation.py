"""The mobile base on real ROS 1, its action watched by a real oracle through the adapter."""

from __future__ import annotations

from pathlib import Path

from tests.missions import every_fault, mission
from tests.ros1.harness import Scene


@every_fault
def test_a_mission_goes_as_its_fault_says(fault: str, tmp_path: Path) -> None:
    mission(Scene, tmp_path, fault)
