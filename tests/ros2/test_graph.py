"""The dump of a live graph: what the example's nodes say and ask, and the deadlock that `check` reads from it."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.processes import PATIENCE, ROOT, ROS_ONLY, SERVER, environment
from tests.ros2.harness import Scene

pytest.importorskip("battery_uav_msgs.msg")
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def test_the_example_s_graph_foretells_its_deadlock(tmp_path: Path) -> None:
    with Scene(tmp_path / "scene") as scene:
        for module in ("led_panel", "supervisor", "battery"):
            scene.node(module, wait_for=99).said("waiting")
        dump = scene.run("dump", sys.executable, "-m", "oracle_ros2", "--dump-graph")
        dump.wait()  # it ends by itself
        dump.ends_well()
        graph = json.loads(dump.log[dump.log.index("{") :])
    nodes = {node["name"]: node for node in graph["nodes"]}
    assert {name: (sorted(n["publishes"]), sorted(n["calls"])) for name, n in nodes.items()} == {
        "/battery": (["/battery_percentage"], []),
        "/battery_supervisor": (["/battery_status", "/input_accepted", "/status_change"], ["/SetLED_mon"]),
        "/led_panel": (["/LED_panel", "/status_accepted"], []),
    }
    assert nodes["/battery_supervisor"]["calls"] == {"/SetLED_mon": ["battery_uav_msgs/srv/SetLED"]}
    assert nodes["/battery_supervisor"]["subscribes"] == {"/status_change": ["battery_uav_msgs/msg/StatusChange"]}

    file, spec = tmp_path / "graph.json", tmp_path / "waits.yaml"
    file.write_text(json.dumps(graph), encoding="utf-8")
    spec.write_text(
        (ROOT / "specs" / "battery_uav.yaml").read_text(encoding="utf-8").replace("max_delay: 200ms", "max_delay: none")
    )
    command = [SERVER, "check", spec, "--ros-graph", file]
    ended = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, env=environment(ROS_ONLY), check=False
    )
    assert ended.returncode == 1
    assert "deadlock: /SetLED -> /battery_status -> /SetLED" in ended.stderr
    assert "by /battery_supervisor" in ended.stderr


def test_a_dump_of_nodes_that_share_a_name_says_that_it_lacks_some(tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        peer, _ = scene.peer(), scene.peer()
        peer.until(lambda: peer.node.get_node_names().count("peer") == 2, "the other one is not discovered")
        dump = scene.run("dump", sys.executable, "-m", "oracle_ros2", "--dump-graph")
        dump.said("several nodes are named /peer: the graph has only what one of them publishes")
        dump.wait()
        dump.ends_well()
