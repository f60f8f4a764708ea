"""What is on its way when something ends on real ROS 1: the adapter, ROS itself, the master."""

from __future__ import annotations

import re
import signal
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from std_msgs.msg import Int64
from std_srvs.srv import SetBool, SetBoolResponse

from tests.processes import eventually, held_port
from tests.robot import ENDLESS, GATE, HELD, SWITCH, spec_folder
from tests.ros1.harness import Peer, Process, Scene

SERVICE = SWITCH.partition("streams:\n")[2].partition("properties:")[0]
BOTH = GATE.replace("properties:", SERVICE + "properties:") + SWITCH.partition("properties:\n")[2]
"""The gate and the switch in one spec."""


def say_on(_: Any) -> SetBoolResponse:
    return SetBoolResponse(True, "on")


def opened(scene: Scene) -> tuple[Peer, Peer]:
    """A node that publishes and one that hears, which are connected through the adapter."""
    speaker, hearer = scene.peer(), scene.peer()
    hearer.record(Int64, "/number", speakers=1)
    speaker.advertise(Int64, "/number_mon")
    return speaker, hearer


def ended(scene: Scene, adapter: Process, how: str) -> None:
    if how == "rosnode kill":
        scene.run("killer", "rosnode", "kill", "/uav1").wait()
        adapter.wait()
    adapter.ends_well(signal.SIGTERM if how == "rosnode kill" else signal.Signals[how])


@pytest.mark.parametrize(
    ("how", "policy"),
    [("SIGINT", "deny"), ("SIGTERM", "deny"), ("SIGHUP", "deny"), ("SIGTERM", "pass"), ("rosnode kill", "deny")],
)
def test_what_waits_when_the_adapter_ends_does_not_pass_and_history_knows(
    how: str, policy: str, tmp_path: Path
) -> None:
    text = HELD.replace("on_unavailable: deny", f"on_unavailable: {policy}")
    with Scene(tmp_path, spec_folder(tmp_path, text)) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer = opened(scene)
        speaker.publish("/number_mon", *[Int64(data=number) for number in range(1, 21)])
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 20)
        ended(scene, adapter, how)
        events = scene.server.events("s")
        assert [(event["seq"], event["kind"], event["passed"]) for event in events] == [
            (seq, "unavailable", False) for seq in range(1, 21)
        ]
        assert hearer.heard("/number") == []


@pytest.mark.parametrize("policy", ["deny", "pass"])
@pytest.mark.parametrize("how", ["SIGTERM", "rosnode kill"])
def test_a_call_that_waits_when_the_adapter_ends_is_an_error_and_reaches_nobody(
    how: str, policy: str, tmp_path: Path
) -> None:
    text = ENDLESS.replace("decide_within: 60s", f"decide_within: 60s\n    on_unavailable: {policy}")
    with Scene(tmp_path, spec_folder(tmp_path, text)) as scene:
        adapter, panel, caller = scene.adapter("switch"), scene.peer(), scene.peer()
        panel.serve(SetBool, "/switch", say_on)
        call = caller.begin(SetBool, "/switch_mon", True)
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 1)
        ended(scene, adapter, how)
        answer = caller.answer(call)
        assert answer is not None
        assert answer[0] is None
        assert panel.reached("/switch") == []
        [event] = scene.server.events("s")
        assert (event["kind"], event["passed"]) == ("unavailable", False)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_adapter_that_waits_for_a_master_can_be_ended(number: signal.Signals, tmp_path: Path) -> None:
    with ExitStack() as stack, Scene(tmp_path) as scene:
        scene.settings["ROS_MASTER_URI"] = f"http://127.0.0.1:{held_port(stack)}"
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", "--oracle", scene.server.url)
        adapter.said("master may not be running yet")
        adapter.ends_well(number)


def test_an_adapter_whose_name_another_node_takes_says_so(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        adapter = scene.adapter("gate")
        scene.run("taker", "rostopic", "pub", "/other", "std_msgs/Empty", "__name:=uav1")
        assert adapter.wait() == 2
        adapter.said("the monitor has ended: another node was started as /uav1")


@pytest.mark.parametrize("session", ["s", "t"])
def test_an_adapter_with_the_name_of_another_one_does_not_start_and_that_one_goes_on(
    session: str, tmp_path: Path
) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        first = scene.adapter("gate")
        words = ("--oracle", scene.server.url, "--spec", "gate", "--session", session, "__name:=uav1")
        second = scene.run("second", sys.executable, "-m", "oracle_ros1", *words)
        assert second.wait() == 2
        second.said("another node named /uav1 runs at http://.*: waiting for its end")
        second.said("would be ended by this one: give this one another name by --monitor, or end that one")
        opened(scene)
        first.ends_well()


def test_an_adapter_that_is_started_while_the_one_before_it_ends_waits_for_it(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        first = scene.adapter("gate")
        words = ("--oracle", scene.server.url, "--spec", "gate", "--session", "s", "--monitor", "uav1")
        second = scene.run("second", sys.executable, "-m", "oracle_ros1", *words)
        second.said("waiting for its end")
        first.ends_well()
        second.said("observing")
        second.ends_well()


IN_CPP = """
import os, sys
from xmlrpc.client import ServerProxy
from xmlrpc.server import SimpleXMLRPCServer
server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
server.register_function(lambda *_: (1, "", 0), "publisherUpdate")
for name in sys.argv[1:]:
    address = "http://127.0.0.1:%d" % server.server_address[1]
    ServerProxy(os.environ["ROS_MASTER_URI"]).registerPublisher(name, name + "/led", "std_msgs/Bool", address)
print("registered", flush=True)
server.serve_forever()
"""
"""A node that, as those in C++, does not tell its name."""


def test_an_adapter_takes_the_name_of_one_whose_port_a_node_in_c_has_by_now(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        scene.run("led", sys.executable, "-c", IN_CPP, "/led", "/uav1").said("registered")
        adapter = scene.adapter("gate")
        assert "waiting for its end" not in adapter.log
        adapter.ends_well()


def test_an_adapter_does_not_take_the_name_of_a_node_in_c(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        scene.run("led", sys.executable, "-c", IN_CPP, "/uav1").said("registered")
        words = ("--oracle", scene.server.url, "--spec", "gate", "--session", "s", "--monitor", "uav1")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        assert adapter.wait() == 2
        adapter.said("another node named /uav1 runs at http://.*, and would be ended by this one")


def test_an_adapter_takes_the_name_of_one_that_was_killed(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        scene.adapter("gate").end(signal.SIGKILL)
        second = scene.adapter("gate")
        assert "waiting for its end" not in second.log
        second.ends_well()


def test_adapters_that_parameters_give_other_names_leave_each_other_alone(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        words = (sys.executable, "-m", "oracle_ros1", f"_oracle:={scene.server.url}", "_spec:=gate")
        made = []
        for name in ("uav1", "uav2"):
            made.append(scene.run(name, *words, f"_monitor:={name}", f"_session:={name}", f"_namespace:=/{name}"))
            made[-1].said(f"observing 2 streams for session {name}")
        assert made[0].running
        for adapter in made:
            adapter.ends_well()


def test_an_adapter_ends_though_the_master_hangs_and_settles_what_waits_at_once(tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer = opened(scene)
        speaker.publish("/number_mon", Int64(1))
        eventually(lambda: scene.server.session("s")["counters"]["held"], lambda held: held == 1)
        scene.master.send(signal.SIGSTOP)
        adapter.ends_well()
        adapter.said("the master does not answer")
        [event] = scene.server.events("s")
        assert (event["kind"], event["passed"]) == ("unavailable", False)
        scene.master.send(signal.SIGCONT)
        assert hearer.heard("/number") == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_adapter_whose_master_hangs_as_the_oracle_comes_can_be_ended(number: signal.Signals, tmp_path: Path) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, HELD)) as scene:
        scene.server.kill()
        words = ("--oracle", scene.server.url, "--spec", "gate", "--session", "s", "--monitor", "uav1")
        adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", *words)
        adapter.said("waiting for the oracle")
        scene.master.send(signal.SIGSTOP)
        scene.server.restart()
        adapter.said("attached s")
        adapter.ends_well(number)
        scene.master.send(signal.SIGCONT)
        assert "observing" not in adapter.log


def test_a_master_that_was_started_anew_learns_of_the_adapter_again(tmp_path: Path) -> None:
    specs = spec_folder(tmp_path, BOTH, intercept="publisher", unavailable="deny", within="60s")
    with Scene(tmp_path, specs) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer = opened(scene)
        scene.restart_master()
        speaker.publish("/number_mon", Int64(1))  # those that know each other need no master
        assert [said.data for said in hearer.heard("/number", 1)] == [1]
        adapter.said("the master did not know .* registered again")
        speaker, hearer = opened(scene)
        speaker.publish("/number_mon", Int64(2))
        assert [said.data for said in hearer.heard("/number", 1)] == [2]
        speaker.serve(SetBool, "/switch", say_on)
        answer, _ = hearer.call(SetBool, "/switch_mon", True)
        assert answer.success
        adapter.ends_well()


def test_a_master_that_does_not_answer_is_told_until_there_is_one_again(tmp_path: Path) -> None:
    """Nobody who comes meanwhile is heard, nor seen who publishes past the monitor."""
    text = r"the master at http://127\.0\.0\.1:\d+ does not answer: who publishes from now on is not heard"
    with Scene(tmp_path, spec_folder(tmp_path, GATE, intercept="publisher", unavailable="deny", within="60s")) as scene:
        adapter = scene.adapter("gate")
        speaker, hearer = opened(scene)

        def troubles() -> list[str]:
            return [s["trouble"] for m in scene.server.session("s")["monitors"] for s in m["streams"]]

        scene.master.remove()
        adapter.said(f"ROS master: {text}")
        eventually(troubles, lambda found: bool(re.match(text, found[0])))
        speaker.publish("/number_mon", Int64(1))
        assert [said.data for said in hearer.heard("/number", 1)] == [1]
        scene.restart_master()
        adapter.said("ROS master: recovered")
        eventually(troubles, lambda found: "master" not in found[0])
        adapter.ends_well()
