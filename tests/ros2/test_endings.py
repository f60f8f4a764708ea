"""What is on its way when an adapter, a service or a session ends, on real ROS 2."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path
from typing import Any

import pytest

from tests.robot import ENDLESS, HELD, SWITCH, spec_folder
from tests.ros2.harness import Peer, Scene, eventually

msg = pytest.importorskip("std_msgs.msg")
srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node, and warns by a function of its own that is deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
DENIED = (False, "not now")


def values(heard: list[Any]) -> list[int]:
    return [said.data for said in heard]


def asked(scene: Scene, peer: Peer) -> list[Any]:
    """Twenty messages that wait for the oracle, and what is heard of them."""
    heard = peer.record(msg.Int64, "/number")
    publisher = peer.publisher(msg.Int64, "/number_mon")
    peer.until(lambda: peer.node.count_publishers("/number") == 1)
    for value in range(1, 21):
        publisher.publish(msg.Int64(data=value))
    return heard


@pytest.mark.parametrize(
    ("number", "policy"),
    [(signal.SIGINT, "deny"), (signal.SIGTERM, "deny"), (signal.SIGHUP, "deny"), (signal.SIGTERM, "pass")],
)
def test_what_waits_when_the_adapter_ends_does_not_pass_and_history_knows(
    number: signal.Signals, policy: str, tmp_path: Path
) -> None:
    text = HELD.replace("on_unavailable: deny", f"on_unavailable: {policy}")
    with Scene(tmp_path, spec_folder(tmp_path, text)) as scene:
        adapter, peer = scene.adapter("gate"), scene.peer()
        heard = asked(scene, peer)
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 20)
        adapter.ends_well(number)
        events = scene.server.events("s")
        assert [(event["seq"], event["kind"], event["passed"]) for event in events] == [
            (seq, "unavailable", False) for seq in range(1, 21)
        ]
        assert [event["decision"] for event in events] == [("deny", "allow")[seq % 7 > 0] for seq in range(1, 21)]
        assert heard == []


def test_what_waits_when_the_streams_change_is_passed_where_history_says_so(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        adapter, peer = scene.adapter("gate"), scene.peer()
        heard = asked(scene, peer)
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 20)
        scene.server.kill()
        shutil.rmtree(tmp_path / "data")
        spec = tmp_path / "specs" / "spec.yaml"
        spec.write_text(spec.read_text(encoding="utf-8").replace("/silent", "/new"))
        scene.server.restart()
        eventually(lambda: adapter.log.count("observing"), lambda count: count == 2)
        events = eventually(
            lambda: scene.server.events("s"),
            lambda found: len(found) == 20 and all(event["passed"] is not None for event in found),
        )
        peer.until(lambda: len(heard) >= sum(event["passed"] for event in events))
        assert values(heard) == [event["seq"] for event in events if event["passed"]]
        adapter.ends_well()


def switch(peer: Peer) -> Any:
    """A call that is on its way."""
    client = peer.node.create_client(srv.SetBool, "/switch_mon")
    peer.until(client.service_is_ready)
    return client.call_async(srv.SetBool.Request(data=True))


def answered(peer: Peer, call: Any) -> tuple[bool, str]:
    peer.until(call.done, "the call is never answered")
    return call.result().success, call.result().message


@pytest.mark.parametrize("policy", ["deny", "pass"])
def test_a_call_that_waits_when_the_adapter_ends_is_denied_and_reaches_nobody(policy: str, tmp_path: Path) -> None:
    text = ENDLESS.replace("decide_within: 60s", f"decide_within: 60s\n    on_unavailable: {policy}")
    with Scene(tmp_path, spec_folder(tmp_path, text)) as scene:
        adapter, peer = scene.adapter("switch"), scene.peer()
        reached: list[bool] = []
        peer.node.create_service(
            srv.SetBool, "/switch", lambda request, response: reached.append(request.data) or response
        )
        call = switch(peer)
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 1)
        adapter.ends_well()
        assert answered(peer, call) == DENIED
        assert reached == []
        [event] = scene.server.events("s")
        assert (event["kind"], event["passed"]) == ("unavailable", False)
        adapter.said("the monitor of /switch ends: call [0-9]+ is answered by denied_response")


@pytest.mark.parametrize("again", [False, True], ids=["for good", "and is there again"])
def test_a_call_of_a_service_that_dies_in_it_is_answered_as_denied(again: bool, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SWITCH)) as scene:
        adapter, peer, panel = scene.adapter("switch"), scene.peer(), scene.peer()
        service = panel.node.create_service(srv.SetBool, "/switch", lambda _, response: response)
        call = switch(peer)  # the panel never spins, and so never answers
        eventually(lambda: scene.server.events("s"), lambda found: found and found[0]["passed"])
        panel.node.destroy_service(service)
        if again:
            panel.node.create_service(srv.SetBool, "/switch", lambda _, response: response)
        assert answered(peer, call) == DENIED
        adapter.said("/switch is not there: call [0-9]+ is answered by denied_response")
        adapter.ends_well()
