"""The catkin packages on real ROS 1: catkin_make builds and installs them, and roslaunch starts them, as on a robot."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import ROOT, Process, environment, eventually
from tests.ros1.harness import Scene

PACKAGES = {
    "oracle_ros1": "adapters/ros1",
    "battery_uav": "examples/battery_uav/ros1/battery_uav",
    "battery_uav_msgs": "examples/battery_uav/ros1/battery_uav_msgs",
    "navigation": "examples/navigation/ros1/navigation",
    "navigation_msgs": "examples/navigation/ros1/navigation_msgs",
}
UNUSED = {"ROS_LANG_DISABLE": "gencpp:geneus:genlisp:gennodejs"}
PATH = ("PYTHONPATH",)  # of what this environment has of the packages already


@pytest.fixture(scope="module")
def setup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What is to be sourced of a workspace with the packages."""
    if shutil.which("catkin_make") is None and not os.environ.get("CI"):
        pytest.skip("catkin is missing (Debian: apt-get install catkin ros-message-generation libstd-msgs-dev make)")
    workspace = tmp_path_factory.mktemp("workspace")
    for name, folder in PACKAGES.items():
        shutil.copytree(ROOT / folder, workspace / "src" / name, ignore=shutil.ignore_patterns("__pycache__"))
    made = subprocess.run(
        ["catkin_make", "-C", workspace, "install", f"-DPYTHON_EXECUTABLE={sys.executable}"],
        env=environment(PATH, **UNUSED), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout
    return workspace / "install" / "setup.bash"


@contextmanager
def launched(scene: Scene, setup: Path, package: str, file: str, **arguments: object) -> Iterator[Process]:
    """What roslaunch starts; it is ended in order, or it would leave its nodes."""
    words = " ".join(f"{name}:={value}" for name, value in arguments.items())
    script = f"unset PYTHONPATH && source {setup} && exec roslaunch {package} {file} {words}"
    process = scene.run(file, "bash", "-c", script)
    try:
        yield process
    finally:
        process.end(signal.SIGINT)


def test_installed_packages_are_launched(setup: Path, tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        where = f"{sys.executable} -c 'import oracle_ros1; print(oracle_ros1.__file__)'"
        found = scene.run("where", "bash", "-c", f"unset PYTHONPATH && source {setup} && {where}")
        found.said(rf"{setup.parent}/lib/.*/oracle_ros1/__init__.py")
        monitor = {"oracle": scene.server.url, "spec": "battery_uav", "session": "flight", "monitor": "uav7"}
        robot = {"monitors": 1, "fault": "wrong_status"}
        with launched(scene, setup, "oracle_ros1", "oracle.launch", **monitor) as monitoring:
            monitoring.said("observing 7 streams for session flight")
            assert [m["name"] for m in scene.server.session("flight")["monitors"]] == ["uav7"]
            with launched(scene, setup, "battery_uav", "battery_uav.launch", **robot) as flying:
                flying.said(r"\[battery-\d+\] process has finished cleanly")
                eventually(lambda: scene.server.records("flight", "violations"), lambda found: found)
                flying.ends_well(signal.SIGINT)
            monitoring.ends_well(signal.SIGINT)
        assert not scene.server.session("flight")["monitors"][0]["attached"]
