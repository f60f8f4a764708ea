"""The battery UAV on real ROS 1, watched by a real oracle through the adapter."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from battery_uav_msgs import msg

from tests.flights import ATTEMPTS, CAUSES, CHECKS, LAST, RATES, SPEED, Flown
from tests.processes import Process
from tests.ros1.harness import Scene

TOPICS = {
    "/battery_percentage": msg.BatteryPercentage,
    "/input_accepted": msg.InputAccepted,
    "/battery_status": msg.BatteryStatus,
    "/status_accepted": msg.StatusAccepted,
    "/LED_panel": msg.LedPanel,
}


class Flight:
    """The three nodes in a scene, and a node that hears them."""

    def __init__(self, scene: Scene, fault: str = "none", speed: float = SPEED, **supervisor: object) -> None:
        self.scene, self.server, self._speed = scene, scene.server, speed
        self.adapter = scene.adapter("battery_uav")
        self.peer = scene.peer()
        for topic, kind in TOPICS.items():
            self.peer.record(kind, topic)
        self.nodes: dict[str, Process] = {}
        self._start("led_panel", wait_for=2, fault=fault)
        self._start("supervisor", wait_for=2, fault=fault, **supervisor)
        self.nodes["led_panel"].said("ready")
        self._start("battery", wait_for=3)

    def _start(self, module: str, **parameters: object) -> None:
        self.nodes[module] = self.scene.node(module, rate=RATES[module] * self._speed, **parameters)

    def passes(self, cause: int) -> None:
        """Wait until the supervisor has reported on this percentage or a later one."""
        self.peer.until(
            lambda: any(said.id >= cause for said in self.peer.heard("/battery_status")),
            lambda: f"no status of {cause}",
        )

    def land(self) -> Flown:
        """Wait for the end of the countdown, and end everything in order."""
        self.passes(LAST)
        last = stamp(self.peer.heard("/battery_status")[-1])
        self.peer.until(lambda: stamp(self.peer.heard("/LED_panel")[-1]) > last, lambda: "no light after it")
        self.peer.until(lambda: not self.nodes["battery"].running, lambda: "the battery does not end")
        for node in self.nodes.values():
            node.ends_well(signal.SIGINT)
        self.adapter.ends_well()
        heard = {topic: self.peer.heard(topic) for topic in TOPICS}
        assert heard["/input_accepted"][-1].id == heard["/battery_percentage"][-1].id == LAST
        return Flown(self.server, self.adapter, self.nodes["supervisor"], heard, stamp)


@contextmanager
def landed(
    folder: Path, fault: str = "none", act: Callable[[Flight], None] = lambda _: None, **how: object
) -> Iterator[Flown]:
    """A countdown that is over. One on a starved machine tells nothing of causes, and is flown again."""
    for attempt in range(ATTEMPTS):
        with Scene(folder / str(attempt)) as scene:
            flight = Flight(scene, fault, **how)
            act(flight)
            flown = flight.land()
            flown.recorded_as_published()
            if not flown.starved():
                yield flown
                return
    pytest.fail("the machine is too busy")


def stamp(message: Any) -> int:
    return int(message.header.stamp.to_nsec())


@pytest.mark.parametrize("fault", CHECKS)
def test_a_countdown_gets_the_verdicts_of_its_fault(fault: str, tmp_path: Path) -> None:
    with landed(tmp_path, fault) as flown:
        CHECKS[fault](flown)


def test_a_supervisor_that_calls_inside_its_round_completes(tmp_path: Path) -> None:
    with landed(tmp_path, call_inside_callback=True) as flown:
        CHECKS["none"](flown)
        assert flown.supervisor.log.count(": done") == 3


def test_a_server_killed_twice_loses_nothing_and_judges_nothing_twice(tmp_path: Path) -> None:
    def crash(flight: Flight) -> None:
        for times, cause in enumerate((10, 75), start=1):
            flight.passes(cause)
            flight.server.kill()
            flight.passes(cause + 5)
            flight.adapter.said(f"(?s)(oracle: disconnected.*){{{times}}}")
            flight.server.restart()
            flight.adapter.said(f"(?s)(oracle: attached.*){{{times + 1}}}")

    with landed(tmp_path, act=crash, speed=0.5) as flown:
        assert flown.adapter.log.count("oracle: attached") == 3
        assert flown.negative(*CAUSES) == []
