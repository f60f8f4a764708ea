"""Who starts an adapter with a Python that has no ROS is told so."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

ADAPTERS = Path(__file__).resolve().parents[2] / "adapters"
PATIENCE = 60.0


@pytest.mark.parametrize(("ros", "module"), [("ros1", "rospy"), ("ros2", "rclpy")])
def test_where_ros_is_not_sourced_a_sentence_says_so(ros: str, module: str) -> None:
    path = os.pathsep.join(str(ADAPTERS / name) for name in ("common", ros))
    ended = subprocess.run(
        [sys.executable, "-m", f"oracle_{ros}", "--help"],
        env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (2, "")
    (line,) = ended.stderr.splitlines()
    assert line.startswith(f"No module named '{module}': ROS {ros[-1]} is not there for this Python")
