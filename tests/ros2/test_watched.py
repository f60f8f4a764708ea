"""The battery UAV on real ROS 2, watched by a real oracle through the adapter.

REPEAT says how many clean countdowns there are in a row (3).
"""

from __future__ import annotations

import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from benchmarks.paper.algorithm1 import Arrival, never_released
from tests.ros2.harness import Data, Peer, Process, Scene, eventually, without_gaps

msg = pytest.importorskip("battery_uav_msgs.msg")
srv = pytest.importorskip("battery_uav_msgs.srv")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")

TOPICS = {
    "/battery_percentage": msg.BatteryPercentage,
    "/input_accepted": msg.InputAccepted,
    "/battery_status": msg.BatteryStatus,
    "/status_accepted": msg.StatusAccepted,
    "/LED_panel": msg.LedPanel,
}
CAUSES = ["status_matches_percentage", "request_has_a_cause", "response_has_a_request"]
NEGATIVE = ["false", "currently_false"]
LAST = 101  # the id of 0 %
SPEED = 2
"""Times as fast as the example: all nodes alike, so that as many steps as ever lie between cause and effect."""
WARNING = 2
LATENCY = 20_000_000  # ns, as in the spec
ATTEMPTS = 5


class Flight:
    """The three nodes in a scene, what this process heard of them, and what the oracle made of it."""

    def __init__(self, scene: Scene, fault: str = "none", **supervisor: object) -> None:
        self.scene, self.server = scene, scene.server
        self.adapter = scene.adapter("battery_uav")
        self.peer: Peer = scene.peer()
        self.heard = {topic: self.peer.record(kind, topic) for topic, kind in TOPICS.items()}
        self.nodes: dict[str, Process] = {}
        self._start("led_panel", 35.0, wait_for=2, fault=fault)
        self._start("supervisor", 10.0, wait_for=2, fault=fault, **supervisor)
        self.nodes["led_panel"].said("ready")
        self._start("battery", 25.0, wait_for=3)

    def _start(self, module: str, rate: float, **parameters: object) -> None:
        self.nodes[module] = self.scene.node(module, rate=rate * SPEED, **parameters)

    def passes(self, cause: int) -> None:
        """Wait until the supervisor has reported on this percentage or a later one."""
        self.peer.until(lambda: any(said.id >= cause for said in self.heard["/battery_status"]))

    def land(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Wait for the end of the countdown, and end everything in order; the adapter by that signal."""
        self.passes(LAST)
        last = stamp(self.heard["/battery_status"][-1])
        self.peer.until(lambda: self.ids("/battery_percentage")[-1] == self.ids("/input_accepted")[-1] == LAST)
        self.peer.until(lambda: stamp(self.heard["/LED_panel"][-1]) > last)
        self.peer.until(lambda: not self.nodes["battery"].running)
        for node in self.nodes.values():
            node.ends_well(signal.SIGINT)
        self.adapter.ends_well(number)

    def starved(self) -> bool:
        """Whether this machine kept messages back for longer than the spec's latency, so that some came late."""
        late = [event for event in self.server.events("s") if event["late"]]
        assert all(event["arrived"] - event["stamp"] > LATENCY for event in late), late
        return bool(late)

    def ids(self, topic: str) -> list[int]:
        return [said.id for said in self.heard[topic]]

    def negative(self, *properties: str) -> list[Data]:
        return self.server.records("s", property=properties, outcome=NEGATIVE)

    def violations(self, *properties: str) -> list[tuple[str, str, str, str]]:
        """Property, stream, kind and the id of the percentage it goes back to."""
        found = self.server.records("s", "violations", property=properties)
        return [(v["property"], v["stream"], v["kind"], cause(v)) for v in found]

    def recorded_as_published(self) -> None:
        """Everything that was published until the last report is in the history, once, and nothing was lost or late."""
        events = self.server.events("s")
        last = stamp(self.heard["/battery_status"][-1])
        for topic, messages in self.heard.items():
            published = [stamp(said) for said in messages if stamp(said) <= last]
            recorded = [event["stamp"] for event in events if event["stream"] == topic and event["stamp"] <= last]
            assert Counter(recorded) == Counter(published), topic
        assert without_gaps([event["seq"] for event in events])
        [monitor] = self.server.session("s")["monitors"]
        assert monitor["next"] == len(events) + 1
        assert not monitor["attached"], "the adapter has not detached"
        counters = self.server.session("s")["counters"]
        assert {name: counters[name] for name in ("held", "refused", "skipped", "lost")} == {
            "held": 0, "refused": 0, "skipped": 0, "lost": 0,
        }  # fmt: skip


@contextmanager
def landed(
    folder: Path, fault: str = "none", act: Callable[[Flight], None] = lambda _: None, **supervisor: object
) -> Iterator[Flight]:
    """A countdown that is over. One on a starved machine tells nothing of causes, and is flown again."""
    for attempt in range(ATTEMPTS):
        with Scene(folder / str(attempt)) as scene:
            flight = Flight(scene, fault, **supervisor)
            act(flight)
            flight.land()
            flight.recorded_as_published()
            if not flight.starved():
                yield flight
                return
    pytest.fail("the machine is too busy")


def stamp(message: Any) -> int:
    return int(message.header.stamp.sec * 10**9 + message.header.stamp.nanosec)


def cause(violation: Data) -> str:
    signals = violation["explanation"]["event"]["signals"]
    return str(signals.get("id") or signals.get("req_id") or signals.get("res_id"))


def calls(flight: Flight) -> list[Data]:
    return flight.server.events("s", stream="/SetLED")


@pytest.mark.parametrize("number", range(int(os.environ.get("REPEAT", "3"))))
def test_a_clean_countdown_has_no_effect_without_its_cause(number: int, tmp_path: Path) -> None:
    with landed(tmp_path) as flight:
        assert flight.negative(*CAUSES) == []
        assert [(c["kind"], c["decision"], c["passed"]) for c in calls(flight)] == 3 * [
            ("request", "allow", True),
            ("response", "allow", True),
        ]
        assert [said.light for said in flight.heard["/LED_panel"]][-1] == "red"


def test_a_wrong_status_is_caught_at_the_status(tmp_path: Path) -> None:
    with landed(tmp_path, "wrong_status") as flight:
        [wrong] = [
            said.id for said in flight.heard["/battery_status"] if said.status == WARNING and not 60 < said.id <= 70
        ]
        assert flight.violations(*CAUSES) == [("status_matches_percentage", "/battery_status", "topic", str(wrong))]


def test_a_status_without_cause_is_caught_at_the_status(tmp_path: Path) -> None:
    with landed(tmp_path, "status_without_cause") as flight:
        assert flight.violations(*CAUSES) == [("status_matches_percentage", "/battery_status", "topic", "0")]


def test_a_request_without_change_is_denied_and_never_reaches_the_service(tmp_path: Path) -> None:
    with landed(tmp_path, "request_without_change") as flight:
        [(_, *where, denied)] = flight.violations(*CAUSES)
        assert where == ["/SetLED", "request"]
        assert 50 < int(denied) <= 60
        changed = [said.id for said in flight.heard["/battery_status"] if said.status_change]
        assert len(changed) == 3
        assert int(denied) not in changed
        assert flight.ids("/status_accepted") == changed
        assert flight.adapter.said(r"denied a request of /SetLED, call 2: (.*)")[1] == "request_has_a_cause"
        outcomes = flight.nodes["supervisor"].said(r"light for id (\d+): denied")
        assert outcomes[1] == denied
        assert flight.nodes["supervisor"].log.count(": done") == 3
        assert [(c["kind"], c["decision"], c["passed"]) for c in calls(flight)] == [
            ("request", "allow", True), ("response", "allow", True),
            ("request", "deny", False),
            ("request", "allow", True), ("response", "allow", True),
            ("request", "allow", True), ("response", "allow", True),
        ]  # fmt: skip


def test_a_silent_panel_is_caught_after_100_steps(tmp_path: Path) -> None:
    with landed(tmp_path, "silent_panel") as flight:
        [violation] = flight.server.records("s", "violations", property="request_is_followed_by_response")
        ignored = [call for call in calls(flight) if call["kind"] == "request"][1]
        assert violation["step"] == ignored["step"] + 100
        assert flight.negative(*CAUSES) == []


def test_a_supervisor_that_calls_inside_its_callback_completes(tmp_path: Path) -> None:
    with landed(tmp_path, call_inside_callback=True) as flight:
        assert flight.server.get("specs/battery_uav")["text"].count("by: publication") == 1
        assert flight.nodes["supervisor"].log.count(": done") == 3
        assert len(calls(flight)) == 6
        assert flight.negative(*CAUSES) == []
        stuck = never_released(arrivals(flight), says_after)
        assert [a.stamp for a in stuck] == [calls(flight)[0]["stamp"]], "Algorithm 1 waits for ever at the first call"


def arrivals(flight: Flight) -> list[Arrival]:
    """What the paper's monitor puts in order, as it arrived here."""
    return [
        Arrival(event["stream"], event["stamp"], event["arrived"], event["kind"])
        for event in flight.server.events("s")
        if event["stream"] in ("/battery_percentage", "/input_accepted", "/battery_status", "/SetLED")
    ]


def says_after(later: Arrival, request: Arrival) -> bool:
    """Whether the supervisor, which waits inside its callback, could not say this before the call was over."""
    return later.buffer != "/battery_percentage" and later.stamp > request.stamp


def test_a_server_killed_and_restarted_twice_loses_nothing_and_judges_nothing_twice(tmp_path: Path) -> None:
    def crash(flight: Flight) -> None:
        for attached, (last, first) in enumerate([(20, 40), (60, 80)], start=2):
            flight.passes(last)
            flight.server.kill()
            flight.passes(first)
            flight.server.restart()
            eventually(lambda: flight.adapter.log.count("oracle: attached"), lambda count, n=attached: count == n)

    with landed(tmp_path, act=crash) as flight:
        records = flight.server.records("s")
        assert [record["n"] for record in records] == list(range(1, len(records) + 1))
        assert flight.negative(*CAUSES) == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_adapter_ends_cleanly_in_mid_flight(number: signal.Signals, tmp_path: Path) -> None:
    with Scene(tmp_path) as scene:
        flight = Flight(scene)
        flight.passes(20)
        before = {topic: [stamp(said) for said in messages] for topic, messages in flight.heard.items()}
        flight.adapter.ends_well(number)
        [monitor] = flight.server.session("s")["monitors"]
        assert not monitor["attached"]
        events = flight.server.events("s")
        assert without_gaps([event["seq"] for event in events])
        assert flight.server.session("s")["counters"]["held"] == 0
        taken = {(event["stream"], event["stamp"]) for event in events}
        ends = {stream: max(at for name, at in taken if name == stream) for stream in before}
        for topic, stamps in before.items():
            assert {(topic, at) for at in stamps if at <= ends[topic]} <= taken
