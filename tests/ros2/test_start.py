"""What ROS refuses as the adapter starts is told, and ends it with 2; it can be ended while it starts."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE, environment
from tests.ros2.harness import Scene

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--ros-args", "-r", "nothing"], "Couldn't parse remap rule: '-r nothing'"),
        (["--ros-args", "--unknown"], r"UnknownROSArgsError: \['--unknown'\]"),
        (["--ros-args", "-p", "use_sim_time:=1"], "Trying to set parameter 'use_sim_time' to '1' of type 'INTEGER'"),
        (["--monitor", "m" * 300], "node name length should not exceed '255'"),
    ],
    ids=["a remap", "an argument", "a parameter", "a name"],
)
def test_what_ros_refuses_is_told_and_ends_with_2(words: list[str], said: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "oracle_ros2", *words]
    settings = environment(ROS_LOG_DIR=str(tmp_path), ROS_DOMAIN_ID="100", ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    ended = subprocess.run(command, env=settings, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert ended.returncode == 2, ended.stderr
    assert "oracle_ros2: error: ROS does not start: " in ended.stderr
    assert "Traceback" not in ended.stderr
    assert re.search(said, ended.stderr), ended.stderr


@pytest.mark.parametrize(
    ("words", "is_for_ros"),
    [(["-r", "__ns:=/uav1"], True), (["-p", "use_sim_time:=true"], True), (["--monitr", "uav1"], False)],
)
def test_what_is_ros_s_own_is_told_to_stand_behind_ros_args(words: list[str], is_for_ros: bool, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "oracle_ros2", *words]
    settings = environment(ROS_LOG_DIR=str(tmp_path), ROS_DOMAIN_ID="100", ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    ended = subprocess.run(command, env=settings, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert ended.returncode == 2, ended.stderr
    assert f"unrecognized arguments: {' '.join(words)}" in ended.stderr
    assert ("behind --ros-args" in ended.stderr) == is_for_ros


def test_an_empty_name_is_none(tmp_path: Path) -> None:
    """As a launch file gives it."""
    with Scene(tmp_path) as scene:
        adapter = scene.run(
            "adapter", sys.executable, "-m", "oracle_ros2", "--oracle", "http://127.0.0.1:1", "--monitor", ""
        )
        adapter.said(r"\[monitor\]: waiting for the oracle")
        adapter.ends_well()


def test_a_dump_that_is_ended_says_nothing_of_what_it_has_not_seen(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer = scene.peer()
        dump = scene.run("dump", sys.executable, "-m", "oracle_ros2", "--dump-graph")
        peer.until(lambda: "oracle_graph" in peer.node.get_node_names(), "the dump does not begin")
        assert dump.end(signal.SIGINT) == 2
        assert "ended before the graph was there" in dump.log
        assert "{" not in dump.log


ENDED_AS_ROS_IS_IMPORTED = """
import os, signal, sys

class Ending:
    def find_spec(self, name, *_):
        if name == "rclpy":
            os.kill(os.getpid(), signal.{name})

sys.meta_path.insert(0, Ending())
from oracle_ros2.__main__ import main
sys.exit(main(["monitor", "--oracle", "http://127.0.0.1:1"]))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_a_signal_that_comes_as_ros_is_imported_ends_it_well(number: signal.Signals, tmp_path: Path) -> None:
    program = ENDED_AS_ROS_IS_IMPORTED.replace("{name}", number.name)
    settings = environment(ROS_LOG_DIR=str(tmp_path), ROS_DOMAIN_ID="100", ROS_AUTOMATIC_DISCOVERY_RANGE="OFF")
    command = [sys.executable, "-c", program]
    ended = subprocess.run(command, env=settings, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert ended.returncode == 0, ended.stderr
    assert "Traceback" not in ended.stderr
