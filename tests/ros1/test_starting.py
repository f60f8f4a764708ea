"""What an adapter for ROS 1 says that can't start on this machine; it can be ended while it starts."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE, beside_server, environment
from tests.ros1.harness import Scene


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


def test_where_rospy_has_no_log_the_console_says_what_is_wrong(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        (tmp_path / "file").touch()
        scene.settings["ROS_LOG_DIR"] = str(tmp_path / "file" / "log")
        words = ("-m", "oracle_ros1", "--oracle", scene.server.url, "--spec", "nothing")
        adapter = scene.run("adapter", sys.executable, *words)
        adapter.said("cannot create log directory")
        adapter.said("unknown_spec: there is no spec 'nothing'")
        assert adapter.end() == 2


def test_a_package_of_ros_that_is_missing_is_named(tmp_path: Path) -> None:
    package = tmp_path / "diagnostic_msgs"
    package.mkdir()
    (package / "__init__.py").touch()
    path = environment(**beside_server()).get("PYTHONPATH", "")
    assert said(PYTHONPATH=f"{tmp_path}:{path}") == "No module named 'diagnostic_msgs.msg'"


ENDED_AS_ROS_IS_IMPORTED = """
import os, signal, sys

class Ending:
    def find_spec(self, name, *_):
        if name == "rospy":
            os.kill(os.getpid(), signal.{name})

sys.meta_path.insert(0, Ending())
from oracle_ros1.__main__ import main
sys.exit(main(["monitor", "--oracle", "http://127.0.0.1:1"]))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=lambda number: number.name)
def test_a_signal_that_comes_as_ros_is_imported_ends_it_well(number: signal.Signals, tmp_path: Path) -> None:
    command = [sys.executable, "-c", ENDED_AS_ROS_IS_IMPORTED.replace("{name}", number.name)]
    settings = environment(ROS_LOG_DIR=str(tmp_path), ROS_MASTER_URI="http://127.0.0.1:1")
    ended = subprocess.run(command, env=settings, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_a_terminal_that_is_closed_ends_it_unless_that_is_ignored() -> None:
    program = """
import signal
from oracle_ros1.stopping import Stopping
for does in (signal.SIG_IGN, signal.SIG_DFL):
    signal.signal(signal.SIGHUP, does)
    stopping = Stopping()
    signal.raise_signal(signal.SIGHUP)
    print(stopping.is_set())
"""
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ended.stdout.split(), ended.stderr) == (["False", "True"], "")
