"""What is told by time: columns with a value a bucket, on a grid that does not depend on who asks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

from oracle_server.history.blocks import Block, Sketch, both, degraded_of, worst_of

Part = Literal["lanes", "violations", "steps", "streams", "decisions"]
PARTS: tuple[Part, ...] = ("lanes", "violations", "steps", "streams", "decisions")


class Grid(NamedTuple):
    """Buckets of a width (ns): so many `buckets` from `since` on, which is a multiple of the width."""

    since: int
    width: int
    buckets: int

    @property
    def until(self) -> int:
        """Where the last one ends."""
        return self.since + self.buckets * self.width


def grid(since: int, until: int, most: int) -> Grid:
    """The narrowest buckets of 1, 2 or 5 times 10^k ns of which so many cover a window, both its ends included."""
    power = 1
    while True:
        for width in (power, 2 * power, 5 * power):
            found = grid_of(width, since, until)
            if found.buckets <= most:
                return found
        power *= 10


def grid_of(width: int, since: int, until: int) -> Grid:
    """The buckets of a width that cover a window."""
    return Grid(since // width * width, width, until // width - since // width + 1)


class Columns:
    """Collects blocks of a session by bucket: its lanes, and the other parts and signals that are wanted."""

    def __init__(self, over: Grid, properties: Sequence[str], parts: frozenset[Part], signals: Sequence[str]) -> None:
        self._grid, self._properties, self._parts = over, properties, parts
        self._lanes: list[tuple[set[str], set[str]]] = [(set(), set()) for _ in range(over.buckets)]
        self._counting = bool(parts - {"lanes"} or signals)
        self._steps, self._late, self._asked, self._denied, self._held, self._longest = (
            [0] * over.buckets for _ in range(6)
        )
        self._violations = [[0] * over.buckets for _ in properties] if "violations" in parts else []
        self._streams: dict[str, tuple[list[int], list[int]]] = {}
        self._signals: dict[str, list[Sketch | None]] = {name: [None] * over.buckets for name in signals}
        self._wanted = [(name, *name.rpartition(":")[::2]) for name in signals]

    def add(self, block: Block) -> None:
        """Add a block that begins in one of the buckets."""
        if not block.worst:
            return
        at = (block.since - self._grid.since) // self._grid.width
        worst, degraded = self._lanes[at]
        worst.add(block.worst)
        degraded.add(block.degraded)
        if self._counting:
            self._count(at, block)

    def _count(self, at: int, block: Block) -> None:
        tally = block.tally
        self._steps[at] += tally.steps
        self._late[at] += tally.late
        if tally.asked:
            self._asked[at] += tally.asked
            self._denied[at] += tally.denied
            self._held[at] += tally.held
            self._longest[at] = max(self._longest[at], tally.longest)
        if self._violations:
            for index, count in tally.violations.items():
                self._violations[int(index)][at] += count
        if "streams" in self._parts:
            for name, stream in tally.streams.items():
                counts = self._streams.get(name)
                if counts is None:
                    counts = self._streams[name] = [0] * self._grid.buckets, [0] * self._grid.buckets
                counts[0][at] += stream.count
                counts[1][at] += stream.lost
        for name, of, signal in self._wanted:
            sketch = tally.streams[of].signals.get(signal) if of in tally.streams else None
            if sketch is not None:
                known = self._signals[name][at]
                self._signals[name][at] = sketch if known is None else both(known, sketch)

    def document(self) -> dict[str, Any]:
        """All of it as plain data."""
        found: dict[str, Any] = {"since": self._grid.since, "width": self._grid.width, "buckets": self._grid.buckets}
        if "lanes" in self._parts:
            blank = " " * len(self._properties)
            worst = [worst_of(texts) or blank for texts, _ in self._lanes]
            degraded = [degraded_of(texts) or blank for _, texts in self._lanes]
            found["lanes"] = _by_name(self._properties, worst)
            found["degraded"] = _by_name(self._properties, degraded)
        if "violations" in self._parts:
            found["violations"] = dict(zip(self._properties, self._violations, strict=True))
        if "steps" in self._parts:
            found |= {"steps": self._steps, "late": self._late}
        if "streams" in self._parts:
            found["streams"] = {n: {"count": c, "lost": lost} for n, (c, lost) in sorted(self._streams.items())}
        if "decisions" in self._parts:
            means = [held // (asked or 1) for held, asked in zip(self._held, self._asked, strict=True)]
            found |= {"asked": self._asked, "denied": self._denied, "hold": {"mean": means, "max": self._longest}}
        found["signals"] = {name: _signal(sketches) for name, sketches in self._signals.items()}
        return found


def _by_name(properties: Sequence[str], texts: Sequence[str]) -> dict[str, str]:
    return dict(zip(properties, map("".join, zip(*texts, strict=True)), strict=True))


def _mean(sketch: Sketch) -> float:
    """The mean of a sketch's numbers: between the least and the largest, also where their sum was cut off."""
    count, least, largest, total = sketch[:4]
    mean: float = max(least, min(total / count, largest))
    return mean


def _signal(sketches: Sequence[Sketch | None]) -> dict[str, list[Any]]:
    """A signal's columns: None where it has no number, or no text, in a bucket."""
    numbers = [sketch if sketch and sketch[0] else None for sketch in sketches]
    texts = [sketch[4:] if sketch else [] for sketch in sketches]
    return {
        "count": [sketch[0] if sketch else 0 for sketch in sketches],
        "min": [sketch and sketch[1] for sketch in numbers],
        "max": [sketch and sketch[2] for sketch in numbers],
        "mean": [sketch and _mean(sketch) for sketch in numbers],
        "text": [text[0] if text else None for text in texts],
        "several": [text == [None] for text in texts],
    }
