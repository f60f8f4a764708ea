"""A UAV's battery, its supervisor and its LED panel, simulated event by event.

    python examples/battery_uav/simulator.py --fault wrong_status --jitter 150ms > trace.jsonl

writes what a monitor would observe, one event a line in the order of arrival. The same arguments
give the same bytes. Times are integer nanoseconds.
"""

import argparse
import heapq
import json
import random
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from operator import itemgetter
from pathlib import Path

US, MS, SECOND = 10**3, 10**6, 10**9
START = 1_732_147_200 * SECOND
BATTERY_PERIOD = SECOND // 25
SUPERVISOR_PERIOD = SECOND // 10
PANEL_PERIOD = SECOND // 35
COUNTDOWN = 101  # messages, from 100 % down to 0

UNKNOWN, HEALTHY, WARNING, CRITICAL = range(4)
LIGHTS = ("off", "green", "yellow", "red")

FAULTS = (
    "wrong_status",  # one status message reports the wrong class
    "status_without_cause",  # one status message more, for an id that no percentage ever had
    "request_without_change",  # one request more, for a status that was no change
    "silent_panel",  # the panel ignores one request
)
FAULTY_ROUND = 20  # of the supervisor's, counted from 0: at 50 %, far from any change
IGNORED_CALL = 2  # by a silent panel, counted from 1: the one for a warning


@dataclass(frozen=True, slots=True)
class Publication:
    """A message, request or response as it was sent; `stamp` is nanoseconds since the epoch."""

    stamp: int
    stream: str
    kind: str
    data: dict[str, object]
    source: str | None = None
    call: int | None = None


def status_of(percentage: float) -> int:
    """Return the status that a percentage, 0 to 100, calls for."""
    return HEALTHY if percentage > 40 else WARNING if percentage > 30 else CRITICAL


class Uav:
    """Three nodes on one clock.

    A node is an iterator that acts and yields how long it waits until it acts again. Every message
    carries the id of the percentage that it goes back to.
    """

    def __init__(self, fault: str | None, seed: int) -> None:
        self.now = START
        self.publications: list[Publication] = []
        self._fault = fault
        self._random = random.Random(seed)
        self._agenda: list[tuple[int, int, Iterator[int]]] = []
        self._order = count()
        self._calls = count(1)
        self._newest = (0, 0.0)  # id and percentage
        self._status = UNKNOWN
        self._shown = (0, UNKNOWN)  # id and status
        for node in (self._battery(), self._supervisor(), self._panel()):
            self._start(node)

    def advance(self) -> None:
        """Go on to what happens next."""
        self.now, _, node = heapq.heappop(self._agenda)
        wait = next(node, None)
        if wait is not None:
            self._start(node, wait)

    def _start(self, node: Iterator[int], wait: int = 0) -> None:
        heapq.heappush(self._agenda, (self.now + wait, next(self._order), node))

    def _battery(self) -> Iterator[int]:
        """Count 100 % down to 0, again and again, under the ids 1, 2, 3…, at 25 Hz."""
        for number in count(1):
            percentage = 100.0 - (number - 1) % COUNTDOWN
            self._publish("/battery", "/battery_percentage", id=number, percentage=percentage)
            self._newest = (number, percentage)
            yield BATTERY_PERIOD

    def _supervisor(self) -> Iterator[int]:
        """Start a round at 10 Hz; none waits for the one before."""
        yield 7 * MS
        for number in count():
            self._start(self._round(faulty=number == FAULTY_ROUND))
            yield SUPERVISOR_PERIOD

    def _round(self, *, faulty: bool) -> Iterator[int]:
        """Take the newest percentage, report its status and, on a change, call for a new light.

        All waits are drawn first, needed or not, so that a fault moves no other message.
        """
        accept, report, call, acknowledge, answer = [self._wait() for _ in range(5)]
        fault = self._fault if faulty else None
        node, (cause, percentage) = "/battery_supervisor", self._newest
        status = status_of(percentage)
        change = status != self._status
        self._status = status
        yield accept
        self._publish(node, "/input_accepted", id=cause)
        yield report
        said = WARNING if fault == "wrong_status" else status
        self._publish(node, "/battery_status", id=cause, status=said, status_change=change)
        yield call
        if fault == "status_without_cause":
            self._publish(node, "/battery_status", id=0, status=status, status_change=False)
        if change or fault == "request_without_change":
            yield from self._set_led(cause, status, acknowledge, answer)

    def _set_led(self, cause: int, status: int, acknowledge: int, answer: int) -> Iterator[int]:
        """Call the panel, as the proxy sees it that stamps the request and then the response."""
        number = next(self._calls)
        self._pass_on("request", number, id=cause, status=status)
        if self._fault == "silent_panel" and number == IGNORED_CALL:
            return
        yield acknowledge
        self._shown = (cause, status)
        self._publish("/led_panel", "/status_accepted", id=cause)
        yield answer
        self._pass_on("response", number, success=True, id=cause)

    def _panel(self) -> Iterator[int]:
        """Tell at 35 Hz which light is on."""
        yield 3 * MS
        while True:
            cause, status = self._shown
            self._publish("/led_panel", "/LED_panel", id=cause, light=LIGHTS[status])
            yield PANEL_PERIOD

    def _wait(self) -> int:
        """Draw the time between a cause and its effect: 100 µs to 2 ms."""
        return 100 * US + int(self._random.random() * 1900 * US)

    def _publish(self, node: str, topic: str, **fields: object) -> None:
        stamp = self._stamp()
        time = {"sec": stamp // SECOND, "nanosec": stamp % SECOND}
        data = {"header": {"stamp": time, "frame_id": ""}, **fields}
        self.publications.append(Publication(stamp, topic, "topic", data, source=node))

    def _pass_on(self, kind: str, call: int, **fields: object) -> None:
        self.publications.append(Publication(self._stamp(), "/SetLED", kind, fields, call=call))

    def _stamp(self) -> int:
        """Return now or, as no two publications share a stamp, the instant after the last one."""
        return max(self.now, self.publications[-1].stamp + 1 if self.publications else 0)


def simulate(
    *, fault: str | None = None, seed: int = 0, countdowns: int = 1, events: int | None = None
) -> list[Publication]:
    """Return what is published in so many countdowns of 4.04 s each, in publication order.

    `fault` is one of `FAULTS` and happens in the first countdown; at most `events` are returned.
    """
    if fault is not None and fault not in FAULTS:
        raise ValueError(f"unknown fault '{fault}'; there are {', '.join(FAULTS)}")
    end = START + countdowns * COUNTDOWN * BATTERY_PERIOD
    most = sys.maxsize if events is None else events
    uav = Uav(fault, seed)
    while len(uav.publications) < most and uav.now < end:
        uav.advance()
    return [publication for publication in uav.publications if publication.stamp < end]


def arrivals(
    publications: list[Publication], jitter_ns: int, seed: int, *, in_order: bool = False
) -> list[dict[str, object]]:
    """Return the lines of a trace, in the order in which the publications reach the monitor.

    Each arrives within `jitter_ns` of its stamp. None overtakes an earlier one of its topic or
    service or, with `in_order`, any earlier one.
    """
    network = random.Random(f"network {seed}")
    newest: dict[str, int] = {}
    arrived = []
    for sent in publications:
        link = "all" if in_order else sent.stream
        delayed = sent.stamp + int(network.random() * jitter_ns)
        newest[link] = max(delayed, newest.get(link, 0) + 1)
        arrived.append((newest[link], sent))
    return [_line(sent, at) for at, sent in sorted(arrived, key=itemgetter(0))]


def _line(sent: Publication, arrived: int) -> dict[str, object]:
    line: dict[str, object] = {"stream": sent.stream, "kind": sent.kind, "monitor": "uav1"}
    line |= {"stamp": sent.stamp, "arrived": arrived, "source": sent.source, "call": sent.call}
    return {key: value for key, value in line.items() if value is not None} | {"data": sent.data}


def trace(publications: list[Publication], jitter_ns: int | None = None, seed: int = 0) -> str:
    """Return a trace in JSON Lines; without a jitter all arrive in order, within 1 ms."""
    if jitter_ns is None:
        lines = arrivals(publications, MS, seed, in_order=True)
    else:
        lines = arrivals(publications, jitter_ns, seed)
    return "".join(json.dumps(line, separators=(",", ":")) + "\n" for line in lines)


def recorded() -> dict[str, str]:
    """Return the traces beside this file, by name."""
    traces = {"in_order": trace(simulate()), "shuffled": trace(simulate(), 150 * MS)}
    return traces | {f"fault_{fault}": trace(simulate(fault=fault)) for fault in FAULTS}


def duration(text: str) -> int:
    """Read `150ms` or `1.5s`, in nanoseconds."""
    match = re.fullmatch(r"(\d+(?:\.\d+)?)(ms|s)", text)
    if match is None:
        raise argparse.ArgumentTypeError(f"'{text}' is no duration such as 150ms or 1.5s")
    return round(float(match[1]) * (MS if match[2] == "ms" else SECOND))


def main() -> None:
    """Write one trace to standard output, or the recorded ones to a directory."""
    parser = argparse.ArgumentParser(description="Simulate a UAV's battery and its LED panel.")
    parser.add_argument("--fault", choices=FAULTS, help="default: none")
    parser.add_argument("--jitter", type=duration, help="longest delay; default: 1ms, in order")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--countdowns", type=int, default=1, help="from 100 to 0, 4 s each")
    parser.add_argument("--events", type=int, help="most events to write")
    parser.add_argument("--all", type=Path, metavar="DIR", help="write the recorded traces to DIR")
    args = parser.parse_args()
    if args.all is None:
        chosen = {"fault": args.fault, "countdowns": args.countdowns, "events": args.events}
        sys.stdout.write(trace(simulate(seed=args.seed, **chosen), args.jitter, args.seed))
        return
    args.all.mkdir(parents=True, exist_ok=True)
    for name, text in recorded().items():
        (args.all / f"{name}.jsonl").write_text(text, encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
