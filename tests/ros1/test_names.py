"""Names on real ROS 1: of the adapter's node, and remaps that would let what has passed come again."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.processes import ROOT, environment
from tests.robot import GATE, HELD, spec_folder
from tests.ros1.actionscene import streams
from tests.ros1.harness import Scene
from tests.ros1.judge import judge
from tests.ros1.test_endings import BOTH

TWO = GATE.replace("streams:\n", "streams:\n  - {topic: /other, type: std_msgs/Int64}\n")


def refused(scene: Scene, url: str, spec: str, *words: str) -> str:
    """What an adapter says that ends with 2 before it observes anything."""
    adapter = scene.run("adapter", "python", "-m", "oracle_ros1", "--oracle", url, "--spec", spec, *words)
    assert adapter.wait() == 2
    assert "Traceback" not in adapter.log
    assert "observing" not in adapter.log
    return adapter.log


@pytest.mark.parametrize(
    ("spec", "words", "told"),
    [
        (HELD, ["/number:=/number_mon"], "/number and its proxy /number_mon would both be /number_mon here"),
        (HELD, ["/number_mon:=/number"], "/number and its proxy /number_mon would both be /number here"),
        (HELD, ["--remap", "/number:=/x", "/x:=/y", "/x_mon:=/y"], "would both be /y here"),
        (BOTH, ["/switch:=/switch_mon"], "/switch and its proxy /switch_mon would both be /switch_mon here"),
        (TWO, ["/other:=/number"], "/other and /number would both be /number here"),
    ],
)
def test_a_remap_that_makes_two_names_one_is_refused(spec: str, words: list[str], told: str, tmp_path: Path) -> None:
    text = spec.replace("INTERCEPT", "publisher").replace("UNAVAILABLE", "deny").replace("WITHIN", "60s")
    with Scene(tmp_path, spec_folder(tmp_path, text)) as scene:
        assert told in refused(scene, scene.server.url, "gate", *words)


def test_a_remap_of_one_topic_of_an_action_to_its_proxy_is_refused(tmp_path: Path) -> None:
    with judge(streams("goal", ask="goal")) as oracle, Scene(tmp_path) as scene:
        told = refused(scene, oracle.url, "s", "/count/goal:=/count_mon/goal")
        assert "/count and its proxy /count_mon would both be /count_mon/goal here" in told


@pytest.mark.parametrize(("monitor", "name"), [("7", "/monitor_7"), ("fleet/7", "/fleet_7")])
def test_the_node_of_a_monitor_of_digits_has_a_name_that_ros_allows(monitor: str, name: str, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        adapter = scene.adapter("gate", monitor=monitor)
        nodes = scene.run("rosnode", "rosnode", "list")
        assert nodes.wait() == 0
        assert name in nodes.log.split()
        adapter.ends_well()
        assert "UserWarning" not in adapter.log


@pytest.mark.parametrize(("monitor", "name"), [("uav1", "/uav1"), ("fleet/uav1", "/fleet_uav1"), ("7", "/7")])
def test_a_launched_monitor_may_have_a_namespace_in_its_name(monitor: str, name: str, tmp_path: Path) -> None:
    command = ["roslaunch", "--nodes", ROOT / "adapters/ros1/launch/oracle.launch", f"monitor:={monitor}"]
    told = subprocess.run(
        command, env=environment(ROS_LOG_DIR=str(tmp_path)), capture_output=True, text=True, check=True
    )
    assert told.stdout.split() == [name]
