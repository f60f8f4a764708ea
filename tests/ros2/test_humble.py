"""The adapter where rclpy has what it had in Humble alone."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.robot import spec_folder
from tests.ros2.harness import Scene, eventually

msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

GUARDED = """
id: guarded
streams:
  - {topic: /cmd, type: std_msgs/msg/Int64, action: filter}
  - {topic: /said, type: std_msgs/msg/String}
  - {service: /led, type: std_srvs/srv/SetBool, action: filter, denied_response: {message: denied}}
properties:
  - {id: small, formula: 'not {topic: /cmd, data: 13}', guards: [/cmd]}
  - {id: on, formula: 'not {service: /led, kind: request, data: false}', guards: [/led]}
"""


def test_it_observes_filters_and_proxies_by_what_humble_has(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, GUARDED)) as scene:
        words = ("--oracle", scene.server.url, "--spec", "guarded", "--session", "s", "--monitor", "uav1")
        adapter = scene.run("adapter", sys.executable, "-m", "tests.ros2.humble", *words)
        adapter.said("observing")
        robot = scene.peer("robot")
        robot.node.create_service(srv.SetBool, "/led", lambda asked, _: srv.SetBool.Response(message=str(asked.data)))
        heard = robot.record(msg.Int64, "/cmd")
        commands = robot.publisher(msg.Int64, "/cmd_mon")
        said = robot.publisher(msg.String, "/said")
        robot.until(lambda: robot.node.count_publishers("/cmd") == 1)
        said.publish(msg.String(data="hello"))
        for number in (12, 13, 14):
            commands.publish(msg.Int64(data=number))
        robot.until(lambda: len(heard) == 2)
        assert [one.data for one in heard] == [12, 14]
        answers = [robot.call(srv.SetBool, "/led_mon", srv.SetBool.Request(data=on)) for on in (True, False)]
        assert [answer.message for answer in answers] == ["True", "denied"]
        eventually(lambda: len(scene.server.events("s")), lambda count: count == 7)
        pilot = scene.peer("pilot")
        pilot.node.create_client(srv.SetBool, "/led")
        pilot.node.create_service(srv.SetBool, "/led_mon", lambda _, answer: answer)
        adapter.said("/led: /pilot can call /led past the monitor; /pilot serves /led_mon beside the monitor")
        adapter.ends_well()


def test_a_module_that_rclpy_lacks_is_not_told_as_ros_that_is_missing(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program = pytest.importorskip("oracle_ros2.__main__")
    monkeypatch.setattr(program.signal, "signal", lambda *_: None)
    monkeypatch.delitem(sys.modules, "oracle_ros2.program", raising=False)
    for missing, hint in (("rclpy.executors", False), ("rclpy", True)):
        with monkeypatch.context() as hidden:
            hidden.setitem(sys.modules, missing, None)
            hidden.delitem(sys.modules, "oracle_ros2.program", raising=False)
            assert program.main([]) == 2
        assert ("source its setup.bash" in capsys.readouterr().err) == hint
