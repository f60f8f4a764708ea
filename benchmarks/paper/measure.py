"""Repeats the paper's experiment on ROS 2, and writes what was measured as CSV.

    source .build/ros2/setup.sh && python3 -m benchmarks.paper.measure [--runs 10] [--out docs/evaluation]

The battery UAV counts down from 100 % at the paper's rates, without a monitor, with one that judges by arrival, and
with one that judges by publication; the last two also with /battery_percentage delayed by up to JITTER ms on its way to
the monitor. `./benchmarks/paper/run` does all that is needed, and draws the figures.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import sqlite3
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.paper.algorithm1 import Arrival, replay
from benchmarks.paper.robot import ROOT, Robot

JITTER = 50
"""ms; the spec's `latency` of that topic is raised above it where it applies."""
SPEC = (ROOT / "specs" / "battery_uav.yaml").read_text()
BY_ARRIVAL = ("by: publication", "by: arrival")
LATENT = (
    "  - topic: /battery_percentage     # 25 Hz\n",
    f"  - topic: /battery_percentage\n    latency: {JITTER + 20}ms\n",
)
CASES: dict[str, tuple[Sequence[tuple[str, str]] | None, int]] = {
    "no monitor": (None, 0),
    "by arrival": ((BY_ARRIVAL,), 0),
    "by publication": ((), 0),
    "by arrival, jitter": ((BY_ARRIVAL, LATENT), JITTER),
    "by publication, jitter": ((LATENT,), JITTER),
}
PAPER = ("/battery_percentage", "/input_accepted", "/battery_status", "/SetLED")
"""What the paper's monitor puts in order."""
COLUMNS = "stream, kind, stamp, arrived, judged, signals, outcomes, late"


@dataclass(frozen=True)
class Row:
    """A judged event; times in nanoseconds."""

    arrival: Arrival
    id: str
    judged: int
    negative: int
    late: bool


def spec_of(changes: Iterable[tuple[str, str]]) -> str:
    text = SPEC
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def events(history: Path) -> list[Row]:
    """What the oracle has recorded, in the order of judging."""
    with closing(sqlite3.connect(f"file:{history / 'history.sqlite'}?mode=ro", uri=True)) as database:
        rows = database.execute(f"SELECT {COLUMNS} FROM steps ORDER BY position").fetchall()
    return [_row(*row) for row in rows]


def _row(stream: str, kind: str, stamp: int, arrived: int, judged: int, signals: str, outcomes: str, late: int) -> Row:
    known: dict[str, Any] = json.loads(signals)
    number = known.get("id") or known.get("req_id") or known.get("res_id") or ""
    negative = sum(outcome in "fF" for outcome in outcomes)
    return Row(Arrival(stream, stamp, arrived, kind), str(number), judged, negative, bool(late))


class Results:
    """The tables, written as they grow."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._files = {
            name: (folder / f"{name}.csv").open("w", newline="") for name in ("events", "calls", "costs", "verdicts")
        }
        self._writers = {name: csv.writer(file, lineterminator="\n") for name, file in self._files.items()}
        self.write("events", "case", "run", "stream", "kind", "id", "buffered_ms", "released_ms", "algorithm1_ms")
        self.write("calls", "case", "run", "call", "response_ms")
        self.write("costs", "case", "run", "process", "cpu_s", "memory_mb", "load")
        self.write("verdicts", "case", "run", "events", "wrong_verdicts", "late")

    def write(self, table: str, *values: object) -> None:
        self._writers[table].writerow([f"{v:.3f}" if isinstance(v, float) else v for v in values])
        self._files[table].flush()


def measure(case: str, number: int, results: Results) -> None:
    changes, jitter = CASES[case]
    with tempfile.TemporaryDirectory(prefix="oracle-paper.") as folder:
        robot = Robot(Path(folder), None if changes is None else spec_of(changes), jitter)
        robot.fly()
        for call, response in enumerate(robot.calls, 1):
            results.write("calls", case, number, call, response)
        for name, cost in robot.costs.items():
            results.write("costs", case, number, name, cost.cpu, cost.memory, os.getloadavg()[0])
        said = f"{case}, run {number}: calls {', '.join(f'{ms:.0f} ms' for ms in robot.calls)}"
        if changes is not None:
            found = events(robot.history)
            wrong, late = sum(row.negative for row in found), sum(row.late for row in found)
            results.write("verdicts", case, number, len(found), wrong, late)
            if BY_ARRIVAL not in changes:
                write_events(case, number, found, results)
            said += f"; {len(found)} events, {wrong} wrong verdicts, {late} late"
        print(said, flush=True)


def write_events(case: str, number: int, found: list[Row], results: Results) -> None:
    """Times since publication: until the event is buffered, is released, and would be by Algorithm 1."""
    rows = [row for row in found if row.arrival.buffer in PAPER]
    theirs = replay(row.arrival for row in rows)
    for row in sorted(rows, key=lambda r: r.arrival.stamp):
        at = row.arrival
        times = (at.arrived, row.judged, theirs.get(at))
        passed: list[object] = ["" if time is None else (time - at.stamp) / 1e6 for time in times]
        results.write("events", case, number, at.buffer, at.kind, row.id, *passed)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "evaluation")
    options = parser.parse_args()
    results = Results(options.out)
    for number in range(1, options.runs + 1):
        for case in CASES:
            measure(case, number, results)


if __name__ == "__main__":
    main()
