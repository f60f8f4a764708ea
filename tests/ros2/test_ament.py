"""The ament_python packages, installed as colcon does it: what `ros2 run` and `ros2 launch` look for is there.

The wheels have neither `colcon` nor `launch`: launch files are read here, and not run.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.processes import ROOT
from tests.ros2.harness import Scene

PACKAGES = {"oracle_ros2": "adapters/ros2", "battery_uav": "examples/battery_uav/ros2/battery_uav"}


@pytest.fixture(scope="module")
def prefix(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace's `install` folder, all packages in one as with `colcon build --merge-install`."""
    folder = tmp_path_factory.mktemp("workspace")
    for name, source in PACKAGES.items():
        package = folder / "src" / name
        shutil.copytree(ROOT / source, package, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
        words = ["install", "--prefix", folder / "install", "--single-version-externally-managed", "--record", "log"]
        made = subprocess.run(
            [sys.executable, "setup.py", *words],
            cwd=package, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
        )  # fmt: skip
        assert made.returncode == 0, made.stdout
    return folder / "install"


def test_what_ros2_run_and_launch_look_for_is_installed(prefix: Path) -> None:
    for package in PACKAGES:
        assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / package).is_file()
        assert (prefix / "share" / package / "package.xml").is_file()
        assert any((prefix / "share" / package / "launch").iterdir())
    launched = ElementTree.parse(prefix / "share" / "battery_uav" / "launch" / "battery_uav.launch.xml")
    programs = {node.get("pkg", "") + "/" + node.get("exec", "") for node in launched.iter("node")}
    assert programs == {"battery_uav/led_panel", "battery_uav/supervisor", "battery_uav/battery"}
    for program in (*programs, "oracle_ros2/monitor"):
        assert os.access(prefix / "lib" / program, os.X_OK), program


def test_the_installed_monitor_runs_with_what_the_launch_file_gives(prefix: Path, tmp_path: Path) -> None:
    tree = ast.parse((prefix / "share" / "oracle_ros2" / "launch" / "oracle.launch.py").read_text(encoding="utf-8"))
    [arguments] = [ast.literal_eval(node) for node in ast.walk(tree) if isinstance(node, ast.Dict)]
    [site] = prefix.glob("lib/python3*/site-packages")
    with Scene(tmp_path) as scene:
        given = {
            **arguments,
            "oracle": scene.server.url,
            "spec": "battery_uav",
            "monitor": "uav7",
            "namespace": "/uav7",
        }
        words = [word for name, value in given.items() for word in (f"--{name}", value)]
        path = f"PYTHONPATH={site}:{os.environ['PYTHONPATH']}"
        where = scene.run("where", "env", path, sys.executable, "-c", "import oracle_ros2; print(oracle_ros2.__file__)")
        where.said(str(site / "oracle_ros2"))
        monitor = scene.run("monitor", "env", path, prefix / "lib" / "oracle_ros2" / "monitor", *words)
        monitor.said("observing 7 streams")
        [session] = scene.server.get("sessions")["items"]
        assert [m["name"] for m in scene.server.session(session["id"])["monitors"]] == ["uav7"]
        monitor.ends_well()
