"""The ament_python packages, built by colcon alone: what `ros2 run` and `ros2 launch` look for is there, and starts.

They are built and run by a Python that has ROS 2 and websockets, and nothing of this project. The wheels have neither
`ros2` nor `launch`: launch files are read here, and not run.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from xml.etree import ElementTree

import pytest

from tests.processes import ROOT, environment
from tests.ros2.harness import Process, Scene

PACKAGES = {
    "oracle_adapter": "adapters/common",
    "oracle_ros2": "adapters/ros2",
    "battery_uav": "examples/battery_uav/ros2/battery_uav",
}
COLCON = ROOT / ".build" / "ros2" / "colcon"
SITE = Path(sysconfig.get_path("purelib"))
MESSAGES = Path(sys.prefix) / "messages" / SITE.relative_to(sys.prefix)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Python without packages: as `PYTHONPATH` has them, links to others' sources are not followed."""
    folder = tmp_path_factory.mktemp("root")
    venv.create(folder, symlinks=True)
    return folder


@pytest.fixture(scope="module")
def prefix(root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A workspace's `install` folder."""
    if not COLCON.exists() and not os.environ.get("CI"):
        pytest.skip("colcon is missing (./scripts/ros2-environment)")
    folder = tmp_path_factory.mktemp("workspace")
    for name, source in PACKAGES.items():
        package = folder / "src" / name
        shutil.copytree(ROOT / source, package, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    settings = {"ROS_VERSION": "2", "PYTHONPATH": f"{COLCON}:{SITE}", "PYTHONNOUSERSITE": "1"}
    made = subprocess.run(
        [root / "bin" / "python3", COLCON / "bin" / "colcon", "build", "--merge-install"],
        env=environment(**settings), cwd=folder,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False,
    )  # fmt: skip
    assert made.returncode == 0, made.stdout
    return folder / "install"


def test_what_ros2_run_and_launch_look_for_is_installed(prefix: Path) -> None:
    for package in PACKAGES:
        assert (prefix / "share" / "ament_index" / "resource_index" / "packages" / package).is_file()
        assert (prefix / "share" / package / "package.xml").is_file()
    launched = ElementTree.parse(prefix / "share" / "battery_uav" / "launch" / "battery_uav.launch.xml")
    programs = {node.get("pkg", "") + "/" + node.get("exec", "") for node in launched.iter("node")}
    assert programs == {"battery_uav/led_panel", "battery_uav/supervisor", "battery_uav/battery"}
    for program in (*programs, "oracle_ros2/monitor"):
        assert os.access(prefix / "lib" / program, os.X_OK), program


def test_the_installed_monitor_runs_with_what_the_launch_file_gives(prefix: Path, root: Path, tmp_path: Path) -> None:
    tree = ast.parse((prefix / "share" / "oracle_ros2" / "launch" / "oracle.launch.py").read_text(encoding="utf-8"))
    [arguments] = [ast.literal_eval(node) for node in ast.walk(tree) if isinstance(node, ast.Dict)]
    [site] = prefix.glob("lib/python3*/site-packages")
    ros = f"export PYTHONNOUSERSITE=1 PYTHONPATH={MESSAGES}:{SITE} PATH={root}/bin:$PATH"
    with Scene(tmp_path) as scene:

        def sourced(name: str, *command: object) -> Process:
            return scene.run(name, "bash", "-c", f'{ros} && source {prefix}/setup.bash && exec "$@"', name, *command)

        given = {
            **arguments,
            "oracle": scene.server.url,
            "spec": "battery_uav",
            "monitor": "uav7",
            "namespace": "/uav7",
        }
        words = [word for name, value in given.items() for word in (f"--{name}", value)]
        where = "import oracle_adapter, oracle_ros2; print(oracle_adapter.__file__, oracle_ros2.__file__)"
        sourced("where", "python3", "-c", where).said(f"{site}/oracle_adapter/.* {site}/oracle_ros2/")
        sourced("help", "python3", "-m", "oracle_ros2", "--help").said("--session")
        monitor = sourced("monitor", prefix / "lib" / "oracle_ros2" / "monitor", *words)
        monitor.said("observing 7 streams")
        [session] = scene.server.get("sessions")["items"]
        assert [m["name"] for m in scene.server.session(session["id"])["monitors"]] == ["uav7"]
        monitor.ends_well()
