"""The battery UAV's nodes on real ROS 2: what they say to each other, and what their faults change.

Each flight runs the three nodes as processes in a domain of its own, twice as fast as the example, and is
recorded by a node in this process. Run with `source .build/ros2/setup.sh && pytest tests/ros2`.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from pathlib import Path
from typing import IO, Any

import pytest

from examples.battery_uav import simulator
from tests.flights import ATTEMPTS, missed_much

rclpy = pytest.importorskip("rclpy")
callback_groups = pytest.importorskip("rclpy.callback_groups")
executors = pytest.importorskip("rclpy.executors")
msg = pytest.importorskip("battery_uav_msgs.msg")
srv = pytest.importorskip("battery_uav_msgs.srv")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

TOPICS = {
    "/battery_percentage": msg.BatteryPercentage,
    "/input_accepted": msg.InputAccepted,
    "/battery_status": msg.BatteryStatus,
    "/status_change": msg.StatusChange,
    "/status_accepted": msg.StatusAccepted,
    "/LED_panel": msg.LedPanel,
}
NODES = ("battery", "supervisor", "led_panel")  # the battery first: it has to wait for the others
SPEED = 2
RATES = {"battery": 25.0 * SPEED, "supervisor": 10.0 * SPEED, "led_panel": 35.0 * SPEED}
PATIENCE = 60.0  # seconds, for a machine under load

Data = dict[str, Any]


class Node:
    """One of the example's nodes in a process of its own."""

    def __init__(self, module: str, domain: int, output: IO[bytes], **parameters: object) -> None:
        words = [f"{name}:={json.dumps(value)}" for name, value in parameters.items()]
        command = [sys.executable, "-m", f"battery_uav.{module}", "--ros-args"]
        command += [word for pair in words for word in ("-p", pair)]
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
        self._output = output
        self.process = subprocess.Popen(command, env=environment, stdout=output, stderr=subprocess.STDOUT)

    def end(self, number: signal.Signals) -> None:
        """Ask the process to end, unless it has, and wait for it."""
        self.process.send_signal(number)
        self.process.wait(PATIENCE)

    @property
    def said(self) -> str:
        return Path(self._output.name).read_text(encoding="utf-8")


class Recorder:
    """A node in this process that hears every topic and, as a proxy, every call."""

    def __init__(self, domain: int) -> None:
        self.heard: list[tuple[str, Any]] = []
        self.calls: list[tuple[str, Data]] = []
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        self._node = rclpy.create_node("recorder", context=self._context)
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        for topic, kind in TOPICS.items():
            self._node.create_subscription(kind, topic, self._hear(topic), 1000)

    def offer_proxy(self) -> None:
        """Offer what the supervisor calls, once the panel is there: a call before that would be lost."""
        group = callback_groups.ReentrantCallbackGroup()
        self._panel = self._node.create_client(srv.SetLED, "/SetLED", callback_group=group)
        self.until(self._panel.service_is_ready)
        self._node.create_service(srv.SetLED, "/SetLED_mon", self._pass_on, callback_group=group)

    def _hear(self, topic: str) -> Callable[[Any], None]:
        return lambda message: self.heard.append((topic, message))

    async def _pass_on(self, request: Any, _response: Any) -> Any:
        self.calls.append(("request", data(request)))
        response = await self._panel.call_async(request)
        self.calls.append(("response", data(response)))
        return response

    def heard_end(self, topic: str) -> bool:
        """Whether a topic is at 0 %."""
        return any((where, said.id) == (topic, simulator.COUNTDOWN) for where, said in reversed(self.heard))

    def until(self, condition: Callable[[], bool]) -> None:
        """Spin until the condition holds."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "the nodes are stuck"
            self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.shutdown(context=self._context)


@dataclass(frozen=True)
class Flight:
    """What was recorded, in the order of the stamps."""

    messages: list[tuple[int, str, Data]]
    calls: list[tuple[str, Data]] = field(default_factory=list)

    def on(self, topic: str) -> list[Data]:
        return [said for _, where, said in self.messages if where == topic]

    def ids(self, topic: str) -> list[int]:
        return [said["id"] for said in self.on(topic)]

    def stamps(self, topic: str) -> dict[int, int]:
        """When each id was first spoken of."""
        return {said["id"]: stamp for stamp, where, said in reversed(self.messages) if where == topic}

    def lights(self) -> list[tuple[int, str]]:
        """The lights one after the other, with their ids."""
        return [light for light, _ in groupby((said["id"], said["light"]) for said in self.on("/LED_panel"))]


def data(message: Any) -> Data:
    """A message as the simulator writes it, but for the header."""
    fields = message.get_fields_and_field_types()
    return {name: getattr(message, name) for name in fields if name != "header"}


def nanoseconds(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


@pytest.fixture
def domain() -> Iterator[int]:
    """A ROS domain that no other test on this machine uses; a bound port says which are taken."""
    for number in range(20, 100):
        with socket.socket() as mark:
            try:
                mark.bind(("127.0.0.1", 21000 + number))
            except OSError:
                continue
            yield number
            return
    pytest.fail("all domains are taken")


@contextmanager
def running(domain: int, folder: Path, **parameters: object) -> Iterator[None]:
    """The three nodes; at the end none is left, and none has ended badly."""
    own = {"supervisor": ("service", "call_inside_callback", "fault"), "led_panel": ("fault",), "battery": ()}
    with ExitStack() as stack:
        nodes = {}
        for module in NODES:
            output = stack.enter_context((folder / module).open("wb"))
            chosen = {name: value for name, value in parameters.items() if name in own[module]}
            listeners = 2 if module == "battery" else 1
            nodes[module] = Node(module, domain, output, rate=RATES[module], wait_for=listeners, **chosen)
            stack.callback(nodes[module].end, signal.SIGKILL)
        yield
        nodes["supervisor"].end(signal.SIGINT)
        nodes["led_panel"].end(signal.SIGTERM)
        nodes["battery"].process.wait(PATIENCE)  # it ends by itself
    for module, node in nodes.items():
        assert node.process.returncode == 0, f"{module}: {node.said}"
        assert not any(word in node.said for word in ("Traceback", "terminate", "ERROR", "never retrieved")), node.said


def fly(
    domain: int, folder: Path, *, proxy: bool = False, last: str = "/battery_status", **parameters: object
) -> Flight:
    """Count down until the topic `last` is at 0 %; without a proxy the supervisor calls the panel itself.

    A flight whose supervisor did not get to hear the battery for long says nothing, and there is another one.
    """
    if not proxy:
        parameters["service"] = "/SetLED"
    for _ in range(ATTEMPTS):
        with running(domain, folder, **parameters), closing(Recorder(domain)) as recorder:
            if proxy:
                recorder.offer_proxy()
            for topic in (last, "/battery_percentage"):  # a cause may be heard behind its effect
                recorder.until(lambda topic=topic: recorder.heard_end(topic))  # type: ignore[misc]
        messages = [(nanoseconds(said), topic, data(said)) for topic, said in recorder.heard]
        flight = Flight(sorted(messages, key=lambda message: message[0]), recorder.calls)
        if not missed_much(flight.ids("/input_accepted")):
            return flight
    pytest.fail("the machine is too busy")


def simulated(stream: str, kind: str = "topic") -> list[Data]:
    """What the simulator says on a stream, but for the headers."""
    sent = [said for said in simulator.simulate() if (said.stream, said.kind) == (stream, kind)]
    return [{name: value for name, value in said.data.items() if name != "header"} for said in sent]


def expected_reports(accepted: list[int]) -> list[Data]:
    """What the simulator's supervisor reports when it takes these percentages; when it takes which is timing."""
    percentages = {said["id"]: said["percentage"] for said in simulated("/battery_percentage")}
    statuses = [simulator.UNKNOWN, *(simulator.status_of(percentages[cause]) for cause in accepted)]
    return [
        {"id": cause, "status": status, "status_change": status != before}
        for cause, (before, status) in zip(accepted, pairwise(statuses), strict=True)
    ]


def changes(reports: list[Data]) -> list[Data]:
    return [{"id": said["id"], "status": said["status"]} for said in reports if said["status_change"]]


def assert_in_order(flight: Flight) -> None:
    """Every effect is stamped after its cause."""
    path = ("/battery_percentage", "/input_accepted", "/battery_status", "/status_change", "/status_accepted")
    for cause, effect in pairwise((*path, "/LED_panel")):
        caused, effected = flight.stamps(cause), flight.stamps(effect)
        for number in set(effected) - {0}:
            assert caused[number] <= effected[number], f"{effect} of id {number} is before its {cause}"


def test_a_countdown_goes_as_the_simulators(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path)
    assert flight.on("/battery_percentage") == simulated("/battery_percentage")
    accepted = flight.ids("/input_accepted")
    assert accepted == sorted(set(accepted))
    assert accepted[-1] == simulator.COUNTDOWN
    reports = expected_reports(accepted)
    assert flight.on("/battery_status") == reports
    assert flight.on("/status_change") == changes(reports)
    assert flight.ids("/status_accepted") == flight.ids("/status_change")
    assert [said["status"] for said in flight.on("/status_change")] == [
        said["status"] for said in simulated("/SetLED", "request")
    ]
    assert flight.lights() == [(0, "off"), *zip(flight.ids("/status_change"), simulator.LIGHTS[1:], strict=True)]
    assert_in_order(flight)


def test_calls_go_through_the_monitors_proxy(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, proxy=True)
    requests = changes(expected_reports(flight.ids("/input_accepted")))
    assert len(requests) == 3
    answered = [(("request", said), ("response", {"success": True, "id": said["id"]})) for said in requests]
    assert flight.calls == [part for call in answered for part in call]


def test_a_call_inside_the_round_waits_for_its_answer(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, call_inside_callback=True)
    reports = expected_reports(flight.ids("/input_accepted"))
    assert flight.on("/battery_status") == reports
    assert not flight.on("/status_change")
    assert flight.ids("/status_accepted") == [said["id"] for said in changes(reports)]
    reported = [stamp for stamp, topic, _ in flight.messages if topic == "/battery_status"]
    for cause, taken in flight.stamps("/status_accepted").items():
        at = flight.ids("/battery_status").index(cause)
        assert reported[at] <= taken <= reported[at + 1], "the supervisor went on without the answer"


def test_a_call_inside_the_round_that_is_never_answered_is_a_deadlock(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, last="/battery_percentage", call_inside_callback=True, fault="silent_panel")
    assert flight.on("/battery_percentage") == simulated("/battery_percentage")
    reports = flight.on("/battery_status")
    assert reports == expected_reports(flight.ids("/input_accepted"))
    assert reports[-1] == {"id": reports[-1]["id"], "status": simulator.WARNING, "status_change": True}
    assert flight.lights() == [(0, "off"), (reports[0]["id"], "green")]


def test_wrong_status_is_one_report_of_another_class(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, fault="wrong_status")
    reports = expected_reports(flight.ids("/input_accepted"))
    wrong = [(said, right) for said, right in zip(flight.on("/battery_status"), reports, strict=True) if said != right]
    [(said, right)] = wrong
    assert 51 <= said["id"] <= 60
    assert said == right | {"status": simulator.WARNING}
    assert flight.on("/status_change") == changes(reports)


def test_status_without_cause_is_one_report_more(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, fault="status_without_cause")
    said = flight.on("/battery_status")
    at = flight.ids("/battery_status").index(0)
    assert 51 <= said[at - 1]["id"] <= 60
    assert said.pop(at) == {"id": 0, "status": simulator.HEALTHY, "status_change": False}
    assert said == expected_reports(flight.ids("/input_accepted"))


def test_request_without_change_is_one_answered_call_more(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, proxy=True, fault="request_without_change")
    reports = expected_reports(flight.ids("/input_accepted"))
    assert flight.on("/battery_status") == reports
    requests = [said for kind, said in flight.calls if kind == "request"]
    extra = requests.pop(1)
    assert requests == changes(reports)
    assert extra["status"] == simulator.HEALTHY
    assert 51 <= extra["id"] <= 60
    assert ("response", {"success": True, "id": extra["id"]}) in flight.calls
    assert extra["id"] in flight.ids("/status_accepted")
    assert [light for _, light in flight.lights()] == ["off", "green", "green", "yellow", "red"]
    assert_in_order(flight)


def test_silent_panel_answers_all_calls_but_one(domain: int, tmp_path: Path) -> None:
    flight = fly(domain, tmp_path, proxy=True, fault="silent_panel")
    reports = expected_reports(flight.ids("/input_accepted"))
    assert flight.on("/battery_status") == reports
    first, ignored, last = changes(reports)
    assert [said for kind, said in flight.calls if kind == "request"] == [first, ignored, last]
    assert [said["id"] for kind, said in flight.calls if kind == "response"] == [first["id"], last["id"]]
    assert flight.ids("/status_accepted") == [first["id"], last["id"]]
    assert flight.lights() == [(0, "off"), (first["id"], "green"), (last["id"], "red")]


@pytest.mark.parametrize("module", ["supervisor", "led_panel"])
def test_an_unknown_fault_is_refused(module: str, domain: int, tmp_path: Path) -> None:
    with (tmp_path / module).open("wb") as output:
        node = Node(module, domain, output, fault="rust")
        assert node.process.wait(PATIENCE) == 1
        assert node.said.startswith("unknown fault 'rust'; there are none, wrong_status")
