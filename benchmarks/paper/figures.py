"""Draws the paper's figures from what `measure` has written, and sums it up.

.build/paper/bin/python -m benchmarks.paper.figures [docs/evaluation]
"""

from __future__ import annotations

import csv
import importlib
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from statistics import mean, median, pstdev
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
TOPICS = ("/battery_percentage", "/input_accepted", "/battery_status")
LINES = (
    ("buffered_ms", "buffered", "tab:blue"),
    ("released_ms", "released", "tab:green"),
    ("algorithm1_ms", "released by Algorithm 1", "tab:red"),
)
NODES = ("battery", "supervisor", "led_panel")
CASES = ("no monitor", "by arrival", "by publication")
ORDERED = "by publication"

Row = dict[str, str]


def read(folder: Path, name: str) -> list[Row]:
    with (folder / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def grouped(rows: Iterable[Row], key: Callable[[Row], Any], column: str) -> dict[Any, list[float]]:
    found: dict[Any, list[float]] = defaultdict(list)
    for row in rows:
        if row[column]:
            found[key(row)].append(float(row[column]))
    return found


def band(axes: Any, values: dict[int, list[float]], label: str, colour: str) -> None:
    """Mean and standard deviation over the runs."""
    ids = sorted(values)
    means = [mean(values[i]) for i in ids]
    spread = [pstdev(values[i]) for i in ids]
    axes.plot(ids, means, ".-", label=label, color=colour, markersize=3, linewidth=0.8)
    low = [max(0.05, m - s) for m, s in zip(means, spread, strict=True)]
    axes.fill_between(ids, low, [m + s for m, s in zip(means, spread, strict=True)], color=colour, alpha=0.2)


def draw_topics(plot: Any, rows: list[Row], target: Path) -> None:
    figure, all_axes = plot.subplots(3, 1, figsize=(9, 10), sharex=True)
    for axes, topic in zip(all_axes, TOPICS, strict=True):
        own = [row for row in rows if row["case"] == ORDERED and row["stream"] == topic]
        for column, label, colour in LINES:
            band(axes, grouped(own, lambda row: int(row["id"]), column), label, colour)
        axes.set(title=topic, ylabel="ms since publication", yscale="log")
        axes.grid(alpha=0.3)
    all_axes[0].legend()
    all_axes[-1].set_xlabel("message id")
    save(plot, figure, target)


def draw_service(plot: Any, rows: list[Row], target: Path) -> None:
    figure, all_axes = plot.subplots(1, 2, figsize=(9, 4), sharey=True)
    for axes, kind in zip(all_axes, ("request", "response"), strict=True):
        own = [row for row in rows if row["case"] == ORDERED and row["kind"] == kind]
        calls = numbered(own)
        for row in own:
            row["call"] = str(calls[row["run"], row["id"]])
        for column, label, colour in LINES:
            values = grouped(own, lambda row: int(row["call"]), column)
            places = sorted(values)
            spread = [pstdev(values[p]) for p in places]
            axes.errorbar(places, [mean(values[p]) for p in places], spread, fmt="o-", label=label, color=colour)
        axes.set(title=f"/SetLED {kind}s", xlabel="call", yscale="log", xticks=(1, 2, 3))
        axes.grid(alpha=0.3)
    all_axes[0].set_ylabel("ms since it was made")
    all_axes[0].legend()
    save(plot, figure, target)


def numbered(rows: list[Row]) -> dict[tuple[str, str], int]:
    """The number of each call of a run, by its id."""
    ids: dict[str, set[str]] = defaultdict(set)
    for row in rows:
        ids[row["run"]].add(row["id"])
    return {(run, i): n for run, own in ids.items() for n, i in enumerate(sorted(own, key=int), 1)}


def draw_bars(
    plot: Any, groups: Sequence[str], values: dict[tuple[str, str], list[float]], unit: str, target: Path
) -> None:
    figure, axes = plot.subplots(figsize=(7, 4))
    for i, case in enumerate(CASES):
        places = [n + (i - 1) * 0.27 for n in range(len(groups))]
        own = [values.get((case, group), [0.0]) for group in groups]
        axes.bar(places, [mean(v) for v in own], 0.25, yerr=[pstdev(v) for v in own], label=case, capsize=3)
    axes.set_ylim(bottom=0)
    axes.set(xticks=range(len(groups)), xticklabels=groups, ylabel=unit)
    axes.grid(alpha=0.3, axis="y")
    axes.legend()
    save(plot, figure, target)


def save(plot: Any, figure: Any, target: Path) -> None:
    figure.tight_layout()
    figure.savefig(target, dpi=110, metadata={"Software": None})
    plot.close(figure)


def summed(costs: list[Row], column: str, names: Sequence[str]) -> dict[str, list[float]]:
    """By case, each run's sum over some processes."""
    found: dict[tuple[str, str], float] = defaultdict(float)
    for row in costs:
        if row["process"] in names:
            found[row["case"], row["run"]] += float(row[column])
    return grouped(({"case": c, "v": str(v)} for (c, _), v in found.items()), lambda row: row["case"], "v")


def holds(rows: Iterable[Row], until: str) -> list[float]:
    return [float(row[until]) - float(row["buffered_ms"]) for row in rows if row[until]]


def spread(values: list[float]) -> str:
    return f"{mean(values):.1f} ± {pstdev(values):.1f}"


def summary(folder: Path) -> str:
    """The numbers, as tables in Markdown."""
    events, calls = read(folder, "events"), read(folder, "calls")
    costs, verdicts = read(folder, "costs"), read(folder, "verdicts")
    cases = list(dict.fromkeys(row["case"] for row in costs))
    by_call = grouped(calls, lambda row: (row["case"], row["call"]), "response_ms")
    lines = [
        "| case | runs | response of call 1, 2, 3 (ms) | wrong verdicts | runs with some | late |",
        "|" + "---|" * 6,
    ]
    for case in cases:
        own = [row for row in verdicts if row["case"] == case]
        runs = len({row["run"] for row in costs if row["case"] == case})
        wrong = [int(row["wrong_verdicts"]) for row in own]
        told = (str(sum(wrong)), str(sum(w > 0 for w in wrong)), str(sum(int(r["late"]) for r in own)))
        response = ", ".join(spread(by_call[case, call]) for call in ("1", "2", "3"))
        lines.append(f"| {case} | {runs} | {response} | {' | '.join(told if own else ('', '', ''))} |")
    lines += ["", "| case | held | median (ms) | mean (ms) | maximum (ms) | mean by Algorithm 1 | maximum by it |"]
    lines.append("|" + "---|" * 7)
    for case in (c for c in cases if c.startswith(ORDERED)):
        for kind in ("topic", "request", "response"):
            own = [row for row in events if row["case"] == case and row["kind"] == kind]
            ours, theirs = holds(own, "released_ms"), holds(own, "algorithm1_ms")
            numbers = (median(ours), mean(ours), max(ours), mean(theirs), max(theirs))
            lines.append(f"| {case} | {kind}s | {' | '.join(f'{n:.1f}' for n in numbers)} |")
    lines += ["", "| case | CPU of the three nodes (s) | their memory (MB) | CPU of monitor and server (s) |"]
    lines.append("|" + "---|" * 4)
    cpu, memory = summed(costs, "cpu_s", NODES), summed(costs, "memory_mb", NODES)
    extra = summed(costs, "cpu_s", ("monitor", "server"))
    for case in cases:
        more = spread(extra[case]) if case in extra else ""
        lines.append(f"| {case} | {spread(cpu[case])} | {spread(memory[case])} | {more} |")
    load = [float(row["load"]) for row in costs]
    lines += [
        "",
        f"Load of the machine during the runs: {min(load):.1f} to {max(load):.1f}, in the mean {mean(load):.1f}.",
    ]
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    matplotlib = importlib.import_module("matplotlib")
    matplotlib.use("Agg")
    plot = importlib.import_module("matplotlib.pyplot")
    events, costs = read(folder, "events"), read(folder, "costs")
    draw_topics(plot, events, folder / "topics.png")
    draw_service(plot, events, folder / "service.png")
    calls = grouped(read(folder, "calls"), lambda row: (row["case"], f"call {row['call']}"), "response_ms")
    draw_bars(plot, ("call 1", "call 2", "call 3"), calls, "ms until the response", folder / "response.png")
    parts = (*NODES, "monitor", "server")
    for column, unit in (("cpu_s", "s of CPU in one countdown"), ("memory_mb", "MB of memory at most")):
        values = grouped(costs, lambda row: (row["case"], row["process"]), column)
        draw_bars(plot, parts, values, unit, folder / f"{column.partition('_')[0]}.png")
    text = summary(folder)
    (folder / "summary.md").write_text(text)
    print(text)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs" / "evaluation")
