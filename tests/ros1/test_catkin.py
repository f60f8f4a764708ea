"""The catkin packages on real ROS 1: catkin_make builds and installs them, and roslaunch starts them, as on a robot.

They are built and run by a Python that has ROS 1 and websockets, and nothing of this project.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sysconfig
import venv
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.processes import ROOT, Process, environment, eventually
from tests.ros1.harness import Scene

PACKAGES = {
    "oracle_adapter": "adapters/common",
    "oracle_ros1": "adapters/ros1",
    "battery_uav": "examples/battery_uav/ros1/battery_uav",
    "battery_uav_msgs": "examples/battery_uav/ros1/battery_uav_msgs",
    "navigation": "examples/navigation/ros1/navigation",
    "navigation_msgs": "examples/navigation/ros1/navigation_msgs",
}
UNUSED = {"ROS_LANG_DISABLE": "gencpp:geneus:genlisp:gennodejs"}
SITE = sysconfig.get_path("purelib")
ROS = ("PYTHONPATH",)  # of what this environment has of the packages already


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The system's Python: as `PYTHONPATH` has websockets, links to others' sources are not followed."""
    folder = tmp_path_factory.mktemp("root")
    venv.create(folder, system_site_packages=True, symlinks=True)
    return folder


@pytest.fixture(scope="module")
def setup(root: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The commands that make a shell ready for the packages of a workspace."""
    if shutil.which("catkin_make") is None and not os.environ.get("CI"):
        pytest.skip("catkin is missing (Debian: apt-get install catkin ros-message-generation libstd-msgs-dev make)")
    workspace = tmp_path_factory.mktemp("workspace")
    for name, folder in PACKAGES.items():
        shutil.copytree(ROOT / folder, workspace / "src" / name, ignore=shutil.ignore_patterns("__pycache__"))
    made = subprocess.run(
        ["catkin_make", "-C", workspace, "install", f"-DPYTHON_EXECUTABLE={root}/bin/python3"],
        env=environment(ROS, **UNUSED), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout
    ros = f"export PYTHONNOUSERSITE=1 PYTHONPATH={SITE} PATH={root}/bin:$PATH"
    return f"{ros} && source {workspace}/install/setup.bash"


@contextmanager
def launched(scene: Scene, setup: str, package: str, file: str, **arguments: object) -> Iterator[Process]:
    """What roslaunch starts; it is ended in order, or it would leave its nodes."""
    words = " ".join(f"{name}:={value}" for name, value in arguments.items())
    script = f"{setup} && exec roslaunch {package} {file} {words}"
    process = scene.run(file, "bash", "-c", script)
    try:
        yield process
    finally:
        process.end(signal.SIGINT)


def test_installed_packages_are_launched(setup: str, tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        where = "import oracle_adapter, oracle_ros1; print(oracle_adapter.__file__, oracle_ros1.__file__)"
        found = scene.run("where", "bash", "-c", f"{setup} && python3 -c '{where}'")
        found.said(r"/install/lib/.*/oracle_adapter/.* .*/install/lib/.*/oracle_ros1/")
        started = scene.run("help", "bash", "-c", f"{setup} && python3 -m oracle_ros1 --help")
        started.said("--session")
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
