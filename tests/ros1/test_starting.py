"""What an adapter for ROS 1 says that can't start on this machine."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE, beside_server, environment


def said(**settings: str) -> str:
    """What an adapter says that ends with 2, which is a line."""
    ended = subprocess.run(
        [sys.executable, "-m", "oracle_ros1", "--spec", "s"],
        env=environment(**settings), capture_output=True, text=True, timeout=PATIENCE, check=False,
    )  # fmt: skip
    assert (ended.returncode, ended.stdout) == (2, "")
    (line,) = ended.stderr.splitlines()
    return line


@pytest.mark.parametrize("address", ["localhost:11311", "robot", "http://robot:99999", "http://", "http://[::1"])
def test_what_is_no_address_of_a_master_is_not_tried_for_ever(address: str, tmp_path: Path) -> None:
    told = said(ROS_MASTER_URI=address, ROS_LOG_DIR=str(tmp_path))
    assert told == f"oracle_ros1: ROS_MASTER_URI: '{address}' is no address like http://localhost:11311"


def test_where_ros_can_not_write_its_log_a_sentence_says_so(tmp_path: Path) -> None:
    taken = tmp_path / "log"
    taken.touch()
    assert said(ROS_LOG_DIR=str(taken)).startswith("oracle_ros1: ROS does not start: LoggingException: Cannot save")


def test_a_package_of_ros_that_is_missing_is_named(tmp_path: Path) -> None:
    package = tmp_path / "diagnostic_msgs"
    package.mkdir()
    (package / "__init__.py").touch()
    path = environment(**beside_server()).get("PYTHONPATH", "")
    assert said(PYTHONPATH=f"{tmp_path}:{path}") == "No module named 'diagnostic_msgs.msg'"
