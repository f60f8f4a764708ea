"""Two monitors of which each gives back what the other one passes, on real ROS 2."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from tests.processes import Process
from tests.ros2.harness import Scene, eventually

action = pytest.importorskip("rclpy.action")
msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")
test_msgs = pytest.importorskip("test_msgs.action")

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
TOPIC = """
id: ID
description: Commands are small
streams:
  - topic: NAME
    type: std_msgs/Int64
    action: filter
    intercept: SIDE
    signals: {value: msg.data}
properties:
  - {id: small, formula: '{topic: NAME} -> {value < 100}', guards: [NAME]}
"""
SERVICE = """
id: ID
description: The light is only put on
streams:
  - service: NAME
    proxy: PROXY
    type: std_srvs/SetBool
    action: filter
    denied_response: {success: false, message: denied}
    request: {signals: {on: msg.data}}
properties:
  - {id: only_on, formula: '{service: NAME, kind: request} -> {on}', guards: [NAME]}
"""
ACTION = """
id: ID
description: Goals are small
streams:
  - ros_action: NAME
    proxy: PROXY
    type: test_msgs/action/Fibonacci
    action: filter
    goal: {signals: {order: msg.order}}
    feedback: {}
properties:
  - {id: small, formula: '{ros_action: NAME, kind: goal} -> {order < 100}', guards: [NAME]}
"""
FOREVER = "would come round for ever"


def guards(folder: Path, **specs: str) -> Path:
    """A folder of specs."""
    made = folder / "specs"
    made.mkdir()
    for name, text in specs.items():
        (made / f"{name}.yaml").write_text(text.replace("ID", name))
    return made


def monitors(scene: Scene, *specs: str) -> list[Process]:
    return [scene.adapter(spec, session=spec, monitor=spec) for spec in specs]


def topic(name: str, side: str) -> str:
    return TOPIC.replace("NAME", f'"{name}"').replace("SIDE", side)


def proxied(text: str, name: str, proxy: str) -> str:
    return text.replace("NAME", f'"{name}"').replace("PROXY", proxy)


def bypass(scene: Scene, session: str) -> str:
    [monitor] = scene.server.session(session)["monitors"]
    return str(monitor["streams"][0]["bypass"])


def test_what_two_monitors_of_one_topic_pass_to_each_other_goes_round_once(tmp_path: Path) -> None:
    specs = guards(tmp_path, before=topic("/cmd", "publisher"), behind=topic("/cmd", "subscriber"))
    with Scene(tmp_path, specs) as scene:
        adapters = monitors(scene, "before", "behind")
        peer = scene.peer()
        pilot = peer.publisher(msg.Int64, "/cmd_mon", listeners=1)
        heard = {name: peer.record(msg.Int64, name) for name in ("/cmd", "/cmd_mon")}
        adapters[0].said(f"/behind is a monitor that hears /cmd and gives /cmd_mon: .* {FOREVER}")
        adapters[1].said(f"/before is a monitor that hears /cmd_mon and gives /cmd: .* {FOREVER}")
        peer.until(lambda: peer.node.count_publishers("/cmd") and peer.node.count_subscribers("/cmd") == 2)
        for number in range(5):
            pilot.publish(msg.Int64(data=number))
            peer.until(lambda number=number: {"data": number} in [{"data": m.data} for m in heard["/cmd"]])
        assert [m.data for m in heard["/cmd"]] == [*range(5)]
        assert [m.data for m in heard["/cmd_mon"]] == [*range(5)]
        assert [e["decision"] for e in scene.server.events("before")] == ["allow"] * 5
        assert scene.server.events("behind") == []
        for session in ("before", "behind"):
            eventually(lambda session=session: bypass(scene, session), lambda text: FOREVER in text)
        adapters[0].ends_well()
        eventually(lambda: bypass(scene, "behind"), lambda text: FOREVER not in text)
        adapters[1].ends_well()


def test_one_monitor_behind_another_is_no_circle_though_it_observes_what_comes_of_it(tmp_path: Path) -> None:
    observed = "  - {topic: /cmd, type: std_msgs/Int64}\nproperties:"
    first = topic("/cmd_mon", "publisher").replace("properties:", observed)
    specs = guards(tmp_path, first=first, second=topic("/cmd", "publisher"))
    with Scene(tmp_path, specs) as scene:
        adapters = monitors(scene, "first", "second")
        peer = scene.peer()
        pilot = peer.publisher(msg.Int64, "/cmd_mon_mon")
        heard = peer.record(msg.Int64, "/cmd")
        peer.until(lambda: peer.node.count_publishers("/cmd") and peer.node.count_publishers("/cmd_mon"))

        def arrives() -> bool:
            pilot.publish(msg.Int64(data=1))
            return bool(heard)

        peer.until(arrives)
        assert not any(FOREVER in adapter.log for adapter in adapters)


def test_a_call_that_two_monitors_would_pass_to_each_other_is_denied(tmp_path: Path) -> None:
    one, other = proxied(SERVICE, "/light", "/light_mon"), proxied(SERVICE, "/light_mon", "/light")
    with Scene(tmp_path, guards(tmp_path, one=one, other=other)) as scene:
        peer = scene.peer()
        calls: list[bool] = []

        def put(request: Any, response: Any) -> Any:
            calls.append(request.data)
            response.success = True
            return response

        peer.node.create_service(srv.SetBool, "/light", put)
        adapters = monitors(scene, "one", "other")
        adapters[0].said(f"/other is a monitor that serves /light and calls /light_mon: .* {FOREVER}")
        adapters[1].said(f"/one is a monitor that serves /light_mon and calls /light: .* {FOREVER}")
        answer = peer.call(srv.SetBool, "/light_mon", srv.SetBool.Request(data=True))
        assert (answer.success, answer.message, calls) == (False, "denied", [])
        assert FOREVER in bypass(scene, "one")


def test_a_goal_that_two_monitors_would_pass_to_each_other_is_rejected(tmp_path: Path) -> None:
    one, other = proxied(ACTION, "/fib", "/fib_mon"), proxied(ACTION, "/fib_mon", "/fib")
    with Scene(tmp_path, guards(tmp_path, one=one, other=other)) as scene:
        server = scene.run("fibonacci", sys.executable, "-m", "tests.ros2.fibonacci", 0.01)
        adapters = monitors(scene, "one", "other")
        server.said("ready")
        for adapter, name in zip(adapters, ("/other", "/one"), strict=True):
            adapter.said(f"{name} is a monitor that serves .*/send_goal: .* {FOREVER}")
        peer = scene.peer()
        client = action.ActionClient(peer.node, test_msgs.Fibonacci, "/fib_mon")
        peer.made.append(client)
        peer.until(client.server_is_ready)
        answer = client.send_goal_async(test_msgs.Fibonacci.Goal(order=5))
        peer.until(answer.done)
        assert not answer.result().accepted
        assert "goal" not in server.log
