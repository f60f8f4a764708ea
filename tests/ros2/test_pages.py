"""The adapters that pages of the documents start, as they start them, observe what the page's spec says."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import pytest

from tests.pages import ADDRESS, steps
from tests.processes import ROOT
from tests.ros2.harness import Process, Scene, eventually

messages = pytest.importorskip("geometry_msgs.msg")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def started(scene: Scene, page: str) -> Process:
    """The adapter that a page starts, at the scene's server."""
    commands = (step.command for step in steps((ROOT / "docs" / page).read_text()))
    (command,) = (each for each in commands if each.startswith("python3 -m oracle_ros2"))
    adapter = scene.run("adapter", sys.executable, *shlex.split(command.replace(ADDRESS, scene.server.url))[1:])
    adapter.said("observing")
    return adapter


def folder(path: Path, page: str) -> Path:
    """A folder with the page's first spec; what has Nav2's fields stands for it."""
    text = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / page).read_text(), re.DOTALL)[0]
    specs = path / "specs"
    specs.mkdir()
    (specs / "spec.yaml").write_text(text.replace("nav2_msgs/", "navigation_msgs/"))
    return specs


def test_the_tutorials_robot_is_judged(tmp_path: Path) -> None:
    with Scene(tmp_path, folder(tmp_path, "tutorial.md")) as scene:
        adapter = started(scene, "tutorial.md")
        command = messages.Twist()
        command.linear.x = 0.3
        scene.peer().publisher(messages.Twist, "/cmd_vel").publish(command)
        found = eventually(lambda: scene.server.records("live", "violations"), lambda found: len(found) == 2)
        assert {each["property"] for each in found} == {"keeps_clear", "sees"}
        adapter.ends_well()


def test_an_action_as_nav2s_is_guarded(tmp_path: Path) -> None:
    with Scene(tmp_path, folder(tmp_path, "guard-nav2.md")) as scene:
        adapter = started(scene, "guard-nav2.md")
        (monitor,) = eventually(lambda: scene.server.session("drive1")["monitors"], bool)
        assert monitor
        adapter.ends_well()
