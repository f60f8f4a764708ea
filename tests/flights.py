"""The battery UAV's countdowns on either ROS, and what must be true of them: each fault has its verdicts."""

from __future__ import annotations

import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Protocol

import pytest

from tests.processes import ROOT, Data, Process, Server, without_gaps
from tests.robot import ALLOWED, done

TOPICS = {
    "/battery_percentage": "BatteryPercentage",
    "/input_accepted": "InputAccepted",
    "/battery_status": "BatteryStatus",
    "/status_accepted": "StatusAccepted",
    "/LED_panel": "LedPanel",
}
"""What is heard, and the type in `battery_uav_msgs`."""

CAUSES = ["status_matches_percentage", "request_has_a_cause", "response_has_a_request"]
NEGATIVE = ["false", "currently_false"]
LAST = 101  # the id of 0 %
SPEED = 2
"""Times as fast as the example: all nodes alike, so that as many steps as ever lie between cause and effect."""
RATES = {"battery": 25.0, "supervisor": 10.0, "led_panel": 35.0}
"""Hz, in the example."""
ATTEMPTS = 7
"""Flights until one is on a machine that is not starved."""
PATIENT_ATTEMPTS = 4
PATIENT = {"max_delay: 200ms": "max_delay: 1s", "action: log\n": "action: log\n    latency: 300ms\n"}
"""What is changed in the spec for them."""
PATIENT_SPEED = 0.25
"""Slow enough that a call is answered before the next one, though the oracle waits for all streams' latency."""
WARNING = 2
LATENCY = 20_000_000  # ns, as in the spec
STAGE = 10
"""Percentages of which a supervisor must take one, to see the warning and to go wrong where a fault says so."""


class Scene(Protocol):
    """A ROS graph with a server, to which a test adds processes."""

    server: Server

    def adapter(self, spec: str) -> Process: ...

    def node(self, module: str, **parameters: object) -> Process: ...


@dataclass(frozen=True)
class Ears:
    """A node that hears the countdown's topics: what it has heard, waiting for more, and a message's stamp (ns)."""

    heard: Callable[[str], Sequence[Any]]
    until: Callable[[Callable[[], object], str], None]
    stamp: Callable[[Any], int]


class Flight:
    """The three nodes in a scene, and a node that hears them."""

    def __init__(self, scene: Scene, ears: Ears, fault: str = "none", speed: float = SPEED, **supervisor: object):
        self.server, self.ears, self._scene, self._speed = scene.server, ears, scene, speed
        self.adapter = scene.adapter("battery_uav")
        self.nodes: dict[str, Process] = {}
        self._start("led_panel", wait_for=2, fault=fault)
        self._start("supervisor", wait_for=2, fault=fault, **supervisor)
        self.nodes["led_panel"].said("ready")
        self._start("battery", wait_for=3)

    def _start(self, module: str, **parameters: object) -> None:
        self.nodes[module] = self._scene.node(module, rate=RATES[module] * self._speed, **parameters)

    def passes(self, cause: int) -> None:
        """Wait until the supervisor has reported on this percentage or a later one."""
        self.ears.until(
            lambda: any(said.id >= cause for said in self.ears.heard("/battery_status")), f"no status of {cause}"
        )

    def land(self) -> Flown:
        """Wait for the end of the countdown, and end everything in order."""
        heard, until, stamp = self.ears.heard, self.ears.until, self.ears.stamp
        self.passes(LAST)
        last = stamp(heard("/battery_status")[-1])
        for topic in ("/battery_percentage", "/input_accepted"):
            until(lambda topic=topic: heard(topic)[-1].id == LAST, f"{topic} does not end")  # type: ignore[misc]
        until(lambda: stamp(heard("/LED_panel")[-1]) > last, "no light after the last status")
        until(lambda: not self.nodes["battery"].running, "the battery does not end")
        for node in self.nodes.values():
            node.ends_well(signal.SIGINT)
        self.adapter.ends_well()
        return Flown(self.server, self.adapter, self.nodes["supervisor"], {t: heard(t) for t in TOPICS}, stamp)


def patient_specs(folder: Path) -> Path:
    """A folder with the battery UAV's spec, made for a machine that keeps messages back now and then."""
    text = (ROOT / "specs" / "battery_uav.yaml").read_text()
    for words, others in PATIENT.items():
        text = text.replace(words, others)
    specs = folder / "patient"
    specs.mkdir()
    (specs / "battery_uav.yaml").write_text(text)
    return specs


@contextmanager
def landed(
    make_scene: Callable[[Path, Path], AbstractContextManager[Scene]],
    listen: Callable[[Any], Ears],
    folder: Path,
    fault: str = "none",
    act: Callable[[Flight], None] = lambda _: None,
    undecided: bool = False,
    **how: Any,
) -> Iterator[Flown]:
    """A countdown that is over. One on a starved machine tells nothing of causes, and is flown again.

    `undecided`: calls without a decision are no sign of that, as the oracle is away now and then.
    The last ones are slower, and by a more patient spec: a machine that is always busy gets through with those.
    """
    folder.mkdir(exist_ok=True)
    for attempt in range(ATTEMPTS):
        specs = ROOT / "specs"
        if attempt >= ATTEMPTS - PATIENT_ATTEMPTS:
            (folder / str(attempt)).mkdir()
            specs, how["speed"] = patient_specs(folder / str(attempt)), PATIENT_SPEED
        with make_scene(folder / str(attempt), specs) as scene:
            flight = Flight(scene, listen(scene), fault, **how)
            act(flight)
            flown = flight.land()
            flown.recorded_as_published()
            if not flown.starved(undecided):
                yield flown
                return
    pytest.fail("the machine is too busy")


def kill_twice(flight: Flight) -> None:
    """Kill the server in the midst of a countdown, and start it again once something was said without it; twice."""
    for times, cause in enumerate((10, 50), start=1):
        flight.passes(cause)
        flight.server.kill()
        flight.passes(cause + 5)
        flight.adapter.said(f"(?s)(oracle: disconnected.*){{{times}}}")
        flight.server.restart()
        flight.adapter.said(f"(?s)(oracle: attached.*){{{times + 1}}}")


@dataclass(frozen=True)
class Flown:
    """A countdown that is over: what a node heard of it by topic, and what the oracle made of it."""

    server: Server
    adapter: Process
    supervisor: Process
    heard: Mapping[str, Sequence[Any]]
    stamp: Callable[[Any], int]

    def starved(self, undecided: bool) -> bool:
        """Whether this machine kept messages back for longer than the spec's latency, so that some came late.

        Or decisions for longer than calls wait for them (unless they may be `undecided`), or the supervisor from its
        rounds.
        """
        events = self.server.events("s")
        late = [event for event in events if event["late"]]
        assert all(event["arrived"] - event["stamp"] > LATENCY for event in late), late
        waited = not undecided and any(event["kind"] == "unavailable" for event in events)
        return bool(late) or waited or missed_much(self.ids("/input_accepted"))

    def ids(self, topic: str) -> list[int]:
        return [said.id for said in self.heard[topic]]

    def changes(self) -> list[int]:
        """The ids of the percentages that changed the status."""
        return [said.id for said in self.heard["/battery_status"] if said.status_change]

    def negative(self, *properties: str) -> list[Data]:
        return self.server.records("s", property=properties, outcome=NEGATIVE)

    def violations(self, *properties: str) -> list[tuple[str, str, str, str]]:
        """Property, stream, kind and the id of the percentage it goes back to."""
        found = self.server.records("s", "violations", property=properties)
        return [(v["property"], v["stream"], v["kind"], cause(v)) for v in found]

    def calls(self) -> Counter[tuple[str, str, bool]]:
        """Kind, decision and whether it passed, of requests and responses: calls overlap on a busy machine."""
        return Counter(done(self.server.events("s", stream="/SetLED")))

    def recorded_as_published(self) -> None:
        """Everything that was published until the last report is in the history, once, and nothing was lost or late."""
        events = self.server.events("s")
        last = self.stamp(self.heard["/battery_status"][-1])
        for topic, messages in self.heard.items():
            published = [self.stamp(said) for said in messages if self.stamp(said) <= last]
            recorded = [event["stamp"] for event in events if event["stream"] == topic and event["stamp"] <= last]
            assert Counter(recorded) == Counter(published), topic
        assert without_gaps([event["seq"] for event in events])
        assert without_gaps(sorted({record["n"] for record in self.server.records("s")}))
        [monitor] = self.server.session("s")["monitors"]
        assert monitor["next"] == len(events) + 1
        assert not monitor["attached"], "the adapter has not detached"
        counters = self.server.session("s")["counters"]
        assert {name: counters[name] for name in ("held", "refused", "skipped", "lost")} == {
            "held": 0, "refused": 0, "skipped": 0, "lost": 0,
        }, counters  # fmt: skip


def missed_much(accepted: Sequence[int]) -> bool:
    """Whether a supervisor, which takes two or three percentages a round, may have missed a stage of the countdown."""
    return any(number - before > STAGE for before, number in pairwise([0, *accepted]))


def cause(violation: Data) -> str:
    signals = violation["explanation"]["event"]["signals"]
    return str(signals.get("id") or signals.get("req_id") or signals.get("res_id"))


def clean(flown: Flown) -> None:
    assert flown.negative(*CAUSES) == []
    assert flown.calls() == Counter(3 * ALLOWED)
    assert flown.heard["/LED_panel"][-1].light == "red"


def wrong_status(flown: Flown) -> None:
    [wrong] = [s.id for s in flown.heard["/battery_status"] if s.status == WARNING and not 60 < s.id <= 70]
    assert flown.violations(*CAUSES) == [("status_matches_percentage", "/battery_status", "topic", str(wrong))]


def status_without_cause(flown: Flown) -> None:
    assert flown.violations(*CAUSES) == [("status_matches_percentage", "/battery_status", "topic", "0")]


def request_without_change(flown: Flown) -> None:
    """The call is denied, and never reaches the service."""
    [(*where, denied)] = flown.violations(*CAUSES)
    assert where == ["request_has_a_cause", "/SetLED", "request"]
    assert 50 < int(denied) <= 60
    assert len(flown.changes()) == 3
    assert int(denied) not in flown.changes()
    assert flown.ids("/status_accepted") == flown.changes()
    assert flown.adapter.said(r"denied a request of /SetLED, call \d+: (.*)")[1] == "request_has_a_cause"
    assert flown.supervisor.said(r"light for id (\d+): denied")[1] == denied
    assert flown.supervisor.log.count(": done") == 3
    assert flown.calls() == Counter([*3 * ALLOWED, ("request", "deny", False)])


def silent_panel(flown: Flown) -> None:
    """The missing response is found after 100 steps."""
    [violation] = flown.server.records("s", "violations", property="request_is_followed_by_response")
    ignored = [call for call in flown.server.events("s", stream="/SetLED") if call["kind"] == "request"][1]
    assert violation["step"] == ignored["step"] + 100
    assert flown.negative(*CAUSES) == []


def called_inside(flown: Flown) -> None:
    """A supervisor that waits for an answer inside its own callback, or round, is not held up for ever."""
    clean(flown)
    assert flown.supervisor.log.count(": done") == 3


def killed_twice(flown: Flown) -> None:
    assert flown.adapter.log.count("oracle: attached") == 3
    assert flown.negative(*CAUSES) == []


CHECKS = {
    "none": clean,
    "wrong_status": wrong_status,
    "status_without_cause": status_without_cause,
    "request_without_change": request_without_change,
    "silent_panel": silent_panel,
}
"""By the fault."""
