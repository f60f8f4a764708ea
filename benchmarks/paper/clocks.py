"""What other clocks would have made of the runs: ones that wait while a stream is silent, and latencies measured.

    .build/server/bin/python -m benchmarks.paper.clocks .build/paper/stalls docs/evaluation

The recorded arrivals of the runs that were judged with `late: judge` are given to the server's order again, with the
clocks that an adapter would have told every 10 ms, and judged as they leave it. What the robot would have done where it
is answered at another time is not known: its messages come as they came. It writes the table clocks.md.
"""

from __future__ import annotations

import json
import sys
from collections import Counter, defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import mean, median

from oracle_adapter import Attention

from benchmarks.paper.kept import Data, read
from benchmarks.paper.stalled import CALM, JUDGE
from benchmarks.paper.truth import Name, Said, in_order, judged, wrong_ones
from oracle_server.core.events import StreamKey
from oracle_server.core.ordering.reorder import Released, ReorderBuffer
from oracle_server.core.spec import Spec
from oracle_server.specfiles.load import load_spec

MS = 1_000_000
SECOND = 1000 * MS
PERIOD = 10 * MS
"""How often an adapter tells its clocks."""
GAPS = 16
REGULAR = 200 * MS
"""A stream that speaks less often is not expected to."""
ENOUGH = 4
STOPPED = SECOND
"""After so long a silence a stream has stopped."""
REMEMBERED = 5 * SECOND
MARGIN = 5 * MS


@dataclass(frozen=True)
class Policy:
    """How clocks are told; times in nanoseconds.

    `latency` is that of all topics, None for each its own in the spec. `silence`: a topic's clock waits once it was
    silent for so many times its usual gap. `measured`: the latency is the longest delay of the last 5 s and 5 ms more,
    and so much at most.
    """

    latency: int | None = None
    silence: int | None = None
    measured: int | None = None
    max_delay: int = 200 * MS


POLICIES = {
    "as it is: 20 ms, percentages 70 ms": Policy(),
    "20 ms": Policy(latency=20 * MS),
    "70 ms": Policy(latency=70 * MS),
    "100 ms": Policy(latency=100 * MS),
    "waits after 3 gaps": Policy(silence=3),
    "waits after 6 gaps": Policy(silence=6),
    "20 ms, waits after 3 gaps": Policy(latency=20 * MS, silence=3),
    "measured": Policy(latency=20 * MS, measured=200 * MS),
    "measured, 70 ms at most": Policy(latency=20 * MS, measured=70 * MS),
    "measured, 70 ms at most, waits after 3 gaps": Policy(latency=20 * MS, measured=70 * MS, silence=3),
    "as it is, max_delay 700 ms": Policy(max_delay=700 * MS),
    "waits after 3 gaps, max_delay 700 ms": Policy(silence=3, max_delay=700 * MS),
}


@dataclass
class Heard:
    """What an adapter knows of a topic: when it spoke last, the gaps between its messages, and their delays."""

    last: int | None = None
    gaps: deque[int] = field(default_factory=lambda: deque(maxlen=GAPS))
    delays: deque[tuple[int, int]] = field(default_factory=deque)

    def take(self, line: Data) -> None:
        now: int = line["arrived"]
        if self.last is not None:
            self.gaps.append(now - self.last)
        self.last = now
        self.delays.append((now, now - line["stamp"]))

    def is_silent(self, now: int, times: int) -> bool:
        if self.last is None or len(self.gaps) < ENOUGH:
            return False
        usual = median(self.gaps)
        return usual <= REGULAR and times * usual < now - self.last < STOPPED

    def latency(self, now: int, otherwise: int, most: int) -> int:
        while self.delays and self.delays[0][0] < now - REMEMBERED:
            self.delays.popleft()
        return min(most, max((delay for _, delay in self.delays), default=otherwise) + MARGIN)


@dataclass(frozen=True)
class Left:
    """An event as it has left the order."""

    line: Data
    at: int
    late: bool


class Simulation:
    """An adapter's clocks and the server's order, over one run's arrivals."""

    def __init__(self, spec: Spec, policy: Policy) -> None:
        self.left: list[Left] = []
        self._policy = policy
        self._streams = {key: stream for key, stream in spec.by_key.items() if stream.ordered}
        self._buffer: ReorderBuffer[Data] = ReorderBuffer(policy.max_delay, spec.ordering.capacity)
        self._buffer.open("uav1", self._streams)
        self._heard: defaultdict[StreamKey, Heard] = defaultdict(Heard)
        self._attention, self._received = Attention(), 0

    def run(self, lines: Iterable[Data]) -> list[Left]:
        clock = None
        for line in sorted(lines, key=lambda line: (line["arrived"], line["seq"])):
            now = line["arrived"]
            clock = now if clock is None else clock
            while clock <= now:
                self._tell(clock)
                clock += PERIOD
            self._take(line, now)
        self._leave(self._buffer.flush(), now)
        return self.left

    def _take(self, line: Data, now: int) -> None:
        self._pass(now)
        key = StreamKey(line["stream"], line["kind"])
        if key.kind == "topic":
            self._received += 1
            self._heard[key].take(line)
        self._leave(self._buffer.push(line, ("uav1", key), line["source"], line["stamp"], now), now)

    def _tell(self, now: int) -> None:
        self._pass(now)
        paid = self._attention.is_paid(now / SECOND, self._received)
        for key in self._streams:
            known = now if key.kind != "topic" else self._reached(key, now) if paid else None
            if known is not None:
                self._leave(self._buffer.clock((("uav1", key), known)), now)

    def _reached(self, key: StreamKey, now: int) -> int | None:
        """What the clock of a topic says, None where it waits."""
        policy, heard = self._policy, self._heard[key]
        if policy.silence is not None and heard.is_silent(now, policy.silence):
            return None
        latency = self._streams[key].latency if policy.latency is None else policy.latency
        return now - (latency if policy.measured is None else heard.latency(now, latency, policy.measured))

    def _pass(self, now: int) -> None:
        while (due := self._buffer.next_deadline) is not None and due <= now:
            self._leave(self._buffer.advance(due), due)

    def _leave(self, released: Iterable[Released[Data]], now: int) -> None:
        self.left += [Left(r.item, now, r.late) for r in released]


@dataclass(frozen=True)
class Flight:
    """A recorded run, and what is right of it."""

    spec: Spec
    lines: list[Data]
    truth: dict[Name, bool | None]


def flights(kept: Path, way: str) -> Iterator[Flight]:
    for path in sorted(kept.glob("*/[0-9][0-9][0-9]/run.json")):
        if json.loads(path.read_text())["way"] == way:
            spec, lines = load_spec(path.parent / "spec.yaml").spec, read(path.parent).trace
            yield Flight(spec, lines, judged(spec, in_order(lines)))


def row(policy: Policy, runs: Sequence[Flight]) -> list[str]:
    """What comes of a policy: late events, wrong verdicts and denials, runs with some, and how long events are held."""
    count: Counter[str] = Counter()
    events, calls = [], []
    for flight in runs:
        left = Simulation(flight.spec, policy).run(flight.lines)
        said = judged(flight.spec, [event.line for event in left])
        wrong = wrong_ones({name: [Said(0, holds)] for name, holds in said.items()}, flight.truth)
        count += Counter(late=sum(event.late for event in left), wrong=len(wrong), runs=bool(wrong))
        asking = {(event.line["monitor"], event.line["seq"]) for event in left if event.line["ask"]}
        guards = {prop.id for prop in flight.spec.properties if prop.guards}
        count["denied"] += len({w.name[:2] for w in wrong if not w.said and w.name[2] in guards} & asking)
        held = [((event.at - event.line["arrived"]) / MS, event.line["kind"]) for event in left]
        events += [ms for ms, _ in held]
        calls += [ms for ms, kind in held if kind != "topic"]
    counts = [str(count[name]) for name in ("late", "wrong", "runs", "denied")]
    return [*counts, f"{mean(events):.0f}", f"{mean(calls):.0f}"]


def main(kept: Path, out: Path) -> None:
    found = {way: runs for way in (CALM, JUDGE) if (runs := list(flights(kept, way)))}
    if not found:
        raise SystemExit(f"{kept} has no runs with `late: judge`; benchmarks.paper.stalled makes them")
    lines = []
    for way, runs in found.items():
        lines += [f"{way}, {len(runs)} runs:", ""]
        lines += ["| clocks | late | wrong | runs with some | calls denied | events held, mean (ms) | of calls (ms) |"]
        lines += ["|" + "---|" * 7]
        lines += [f"| {name} | {' | '.join(row(policy, runs))} |" for name, policy in POLICIES.items()]
        lines += [""]
    text = "\n".join(lines)
    (out / "clocks.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
