"""What was said wrongly in runs with stalls, for how long, and what of it stands at the end.

    .build/server/bin/python -m benchmarks.paper.standing .build/paper/stalls docs/evaluation

It reads what `benchmarks.paper.stalled` has kept, and writes stalls.csv, a line a run; wrong.csv, a line a wrong
verdict; and the table stalls.md.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import mean, median
from typing import Any

from benchmarks.paper.algorithm1 import Arrival, replay
from benchmarks.paper.kept import Data, read
from benchmarks.paper.measure import PAPER
from benchmarks.paper.stalled import JUDGE
from benchmarks.paper.truth import Said, Wrong, in_order, judged, sayings, wrong_ones
from oracle_server.core.spec import Spec
from oracle_server.specfiles.load import load_spec

MS = 1_000_000
COLUMNS = (
    *("way", "run", "events", "stalls", "stalled_s", "held_back", "late"),
    *("wrong_said", "wrong_standing", "denied", "calls_ms", "load"),
)
ALGORITHM_1 = "Algorithm 1"


@dataclass(frozen=True)
class Run:
    """One run as one way of judging has judged it; `held` is how long each event waited (ms)."""

    way: str
    number: int
    stalls: list[tuple[float, int]]
    events: int
    late: int
    wrong: list[Wrong]
    held: list[float]
    calls: list[float]
    denied: int
    load: float

    @property
    def standing(self) -> int:
        return sum(w.lasted is None for w in self.wrong)


def run_of(folder: Path) -> Iterator[Run]:
    """A run as it was judged; where that was by `judge`, also as Algorithm 1 would have judged its arrivals."""
    about, kept = json.loads((folder / "run.json").read_text()), read(folder)
    spec = load_spec(folder / "spec.yaml").spec
    said = sayings(kept.records)
    differing = sum(said[name][-1].holds is not last[-1].holds for name, last in sayings(kept.standing).items())
    if differing:
        raise SystemExit(f"{folder}: {differing} verdicts stand otherwise than they were said last")
    wrong = wrong_ones(said, judged(spec, in_order(kept.trace)))
    places = [(line, line["places"][0]) for line in kept.trace]
    own = Run(
        about["way"],
        about["run"],
        about["stalls"],
        events=len(places),
        late=sum(place["late"] for _, place in places),
        wrong=wrong,
        held=[(place["judged"] - line["arrived"]) / MS for line, place in places],
        calls=about["calls"],
        denied=len({r["seq"] for r in kept.records if r["kind"] != "revision" and r["decision"] == "deny"}),
        load=about["load"],
    )
    yield own
    if own.way == JUDGE:
        yield by_algorithm1(spec, kept.trace, own)


def by_algorithm1(spec: Spec, trace: Iterable[Data], run: Run) -> Run:
    """A run's arrivals on what the paper's monitor puts in order, judged as its algorithm releases them."""
    lines = [line for line in trace if line["stream"] in PAPER]
    own = {Arrival(line["stream"], line["stamp"], line["arrived"], line["kind"]): line for line in lines}
    released = replay(own)
    newest, late = 0, 0
    for arrival in released:
        late += arrival.stamp < newest
        newest = max(newest, arrival.stamp)
    found, truth = judged(spec, [own[a] for a in released]), judged(spec, in_order(lines))
    wrong = wrong_ones({name: [Said(0, holds)] for name, holds in found.items()}, truth)
    held = [(at - a.arrived) / MS for a, at in released.items()]
    return replace(run, way=ALGORITHM_1, events=len(lines), late=late, wrong=wrong, held=held, calls=[], denied=0)


def table(runs: Sequence[Run]) -> str:
    """What was wrong, and what each way costs, as tables in Markdown."""
    by_way = {way: [run for run in runs if run.way == way] for way in dict.fromkeys(run.way for run in runs)}
    lines = [
        "| way | runs | stalls | held back | late | wrong when said | of them stand | runs with some | wrong for |"
    ]
    lines += ["|" + "---|" * 9, *(_verdicts(way, own) for way, own in by_way.items())]
    lines += ["", "| way | held, median | mean | maximum (ms) | call answered, mean | maximum (ms) | calls denied |"]
    lines += ["|" + "---|" * 7, *(_price(way, own) for way, own in by_way.items())]
    stalls = [seconds * 1000 for run in runs for seconds, _ in run.stalls] or [0.0]
    load = [run.load for run in runs]
    lines += [
        "",
        f"The stalls took {min(stalls):.0f} to {max(stalls):.0f} ms, {mean(stalls):.0f} ms in the mean.",
        f"Load of the machine: {min(load):.1f} to {max(load):.1f}, in the mean {mean(load):.1f}.",
    ]
    return "\n".join(lines) + "\n"


def _verdicts(way: str, own: Sequence[Run]) -> str:
    lasted = [w.lasted / 1e9 for run in own for w in run.wrong if w.lasted is not None]
    cells: list[Any] = [
        way,
        len(own),
        sum(len(run.stalls) for run in own),
        sum(count for run in own for _, count in run.stalls),
        sum(run.late for run in own),
        sum(len(run.wrong) for run in own),
        sum(run.standing for run in own),
        sum(run.standing > 0 for run in own),
        f"{median(lasted):.2f} s, {max(lasted):.2f} s at most" if lasted else "",
    ]
    return f"| {' | '.join(map(str, cells))} |"


def _price(way: str, own: Sequence[Run]) -> str:
    held, calls = [ms for run in own for ms in run.held], [ms for run in own for ms in run.calls]
    cells = [f"{ms:.0f}" for ms in (median(held), mean(held), max(held))]
    cells += [f"{mean(calls):.0f}", f"{max(calls):.0f}", str(sum(run.denied for run in own))] if calls else ["", "", ""]
    return f"| {way} | {' | '.join(cells)} |"


def write(folder: Path, runs: Sequence[Run]) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    with (folder / "stalls.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for run in runs:
            stalled, count = sum(s for s, _ in run.stalls), sum(n for _, n in run.stalls)
            calls = " ".join(f"{ms:.1f}" for ms in run.calls)
            numbers = (len(run.stalls), f"{stalled:.3f}", count, run.late, len(run.wrong), run.standing, run.denied)
            writer.writerow((run.way, run.number, run.events, *numbers, calls, f"{run.load:.2f}"))
    with (folder / "wrong.csv").open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("way", "run", "property", "seq", "said", "wrong_for_ms"))
        for run in runs:
            for w in run.wrong:
                lasted = "" if w.lasted is None else f"{w.lasted / MS:.1f}"
                writer.writerow((run.way, run.number, w.name[2], w.name[1], "holds" if w.said else "fails", lasted))
    text = table(runs)
    (folder / "stalls.md").write_text(text)
    print(text)


def main(kept: Path, out: Path) -> None:
    folders = sorted(path.parent for path in kept.glob("*/[0-9][0-9][0-9]/run.json"))
    if not folders:
        raise SystemExit(f"{kept} has no runs; benchmarks.paper.stalled makes them")
    write(out, sorted((run for folder in folders for run in run_of(folder)), key=lambda run: (run.way, run.number)))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
