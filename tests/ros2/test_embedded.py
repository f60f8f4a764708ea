"""An oracle in the adapter's own process, on real ROS 2: what passes, what doesn't, and what outlives a kill."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

import pytest

from tests.processes import Process, beside_server
from tests.robot import GATE, SWITCH, spec_folder
from tests.ros2.acting import SUCCEEDED, Client
from tests.ros2.harness import Scene

msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")

pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)

DRIVE = """
id: drive
description: Goals of an order above 5 are refused
ordering: {max_delay: none}
streams:
  - ros_action: /fib
    type: test_msgs/action/Fibonacci
    action: filter
    ask: [goal]
    decide_within: 60s
    denied_result: {sequence: [9, 9]}
    goal: {signals: {order: msg.order}}
    reply: {}
    result: {}
properties:
  - id: small
    formula: 'not {ros_action: "/fib", kind: goal, order > 5}'
    guards: [/fib]
    blame: any
"""


@pytest.fixture(autouse=True)
def server_beside_ros(monkeypatch: pytest.MonkeyPatch) -> None:
    settings = beside_server()
    if not settings:
        pytest.skip("the server is not installed for this Python")
    monkeypatch.setenv("PYTHONPATH", settings["PYTHONPATH"])


def embedded(scene: Scene, folder: Path) -> Process:
    words = ("--embedded", folder / "specs" / "spec.yaml", "--data", folder / "own", "--session", "s")
    process = scene.run("adapter", sys.executable, "-m", "oracle_ros2", *words)
    process.said("observing")
    return process


def test_a_filtered_topic_goes_on_after_a_kill(tmp_path: Path) -> None:
    gate = spec_folder(tmp_path, GATE, intercept="publisher", unavailable="deny", within="60s")
    with Scene(tmp_path, gate) as scene:
        adapter, peer = embedded(scene, tmp_path), scene.peer()
        heard = peer.record(msg.Int64, "/number")
        speaker = peer.publisher(msg.Int64, "/number_mon")
        for number in range(1, 101):
            speaker.publish(msg.Int64(data=number))
        peer.until(lambda: len(heard) == 86)
        assert [said.data for said in heard] == [n for n in range(1, 101) if n % 7]
        adapter.end(signal.SIGKILL)
        again = embedded(scene, tmp_path)
        heard.clear()

        def passed() -> bool:  # the publisher may not have found the new adapter yet
            speaker.publish(msg.Int64(data=7))
            speaker.publish(msg.Int64(data=8))
            return bool(heard)

        peer.until(passed)
        assert {said.data for said in heard} == {8}
        again.ends_well()


def test_a_proxied_service(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        peer = scene.peer()

        def switch(request: object, response: object) -> object:
            response.success = True  # type: ignore[attr-defined]
            return response

        peer.node.create_service(srv.SetBool, "/switch", switch)
        adapter = embedded(scene, tmp_path)
        assert peer.call(srv.SetBool, "/switch_mon", srv.SetBool.Request(data=True)).success
        denied = peer.call(srv.SetBool, "/switch_mon", srv.SetBool.Request(data=False))
        assert (denied.success, denied.message) == (False, "not now")
        adapter.ends_well()


def test_a_proxied_action(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, DRIVE)) as scene:
        served = scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01)
        adapter = embedded(scene, tmp_path)
        served.said("ready")
        client = Client(scene.peer(), "/fib_mon", 1000)
        assert not client.goal(6).accepted
        passed = client.goal(3)
        assert passed.accepted
        assert client.result(passed) == (SUCCEEDED, [0, 1, 2])
        assert "goal 6" not in served.log
        client.leave()
        adapter.ends_well()
