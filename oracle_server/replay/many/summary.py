"""What many recordings came to, for people: lines for what is wrong, and a table of the properties."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import IO

from oracle_server.core.errors import one_line
from oracle_server.core.units import counted
from oracle_server.process.tables import print_table
from oracle_server.replay.conclusion import gravest
from oracle_server.replay.many.judging import Text
from oracle_server.replay.many.row import Row

_Of = tuple[int, str, bool]
"""A spec by its index, a property, and whether it is of the second order."""


class Tally:
    """Counts the recordings by what their properties came to."""

    def __init__(self, specs: Sequence[Text]) -> None:
        """Of several specs each line names its own; by its file, too, where others have its id."""
        self._several = len(specs) > 1
        ids = Counter(spec.id for spec in specs)
        self._names = [spec.id if ids[spec.id] == 1 else f"{spec.id} ({spec.path})" for spec in specs]
        self._by_path = {spec.path: name for spec, name in zip(specs, self._names, strict=True)}
        self._counts: dict[_Of, Counter[str]] = {
            (i, name, late): Counter()
            for i, spec in enumerate(specs)
            for name in spec.properties
            for late in (False, True)
        }
        self._exits: set[int] = set()
        self.broken: dict[str, str] = {}
        """Why recordings can't be used, by their paths; the first reason of each."""

    @property
    def status(self) -> int:
        """The gravest exit status of all."""
        return gravest(list(self._exits))

    def add(self, spec: int, rows: Sequence[Row]) -> None:
        """Count a result of the spec with an index; rows that were kept may name another file with its text."""
        second = _second(rows)
        for row in rows:
            self._exits.add(row.exit)
            counts = self._counts[spec, row.property, row.order == second]
            counts["recordings"] += 1
            if row.error is not None:
                self.broken.setdefault(row.recording, row.error)
                counts["error"] += 1
            if row.violations:
                counts["violated"] += 1
            elif row.unjudged and row.error is None:
                counts["unjudged"] += 1
            counts["violations"] += row.violations or 0
            counts["episodes"] += row.episodes or 0

    def lines(self, rows: Sequence[Row]) -> Iterator[str]:
        """What is wrong in one recording, by one spec."""
        second = _second(rows)
        for row in rows:
            at = f"{row.recording}: {self._by_path[row.spec_path]}: " if self._several else f"{row.recording}: "
            if row.violations:
                often = f"{counted(row.violations, 'violation')}, {counted(row.episodes or 0, 'episode')}"
                yield one_line(f"{at}{_name(row, second)}: {often}; the first: {row.explanation}")
            elif row.unjudged and row.error is None:
                yield one_line(f"{at}{_name(row, second)} was not judged: {row.unjudged}")
        if rows[0].error is not None:
            yield one_line(named(rows[0].recording, rows[0].error))

    def write(self, out: IO[str]) -> None:
        """Write the table."""
        names = ("property", "recordings", "violated", "violations", "episodes", "not judged", "unusable")
        rows: list[tuple[str, ...]] = []
        for (spec, prop, second), counts in self._counts.items():
            if second and not counts:
                continue
            name = f"{prop} (arrival)" if second else prop
            cells = (counts[key] for key in ("recordings", "violated", "violations", "episodes", "unjudged", "error"))
            rows.append((*([self._names[spec]] if self._several else []), name, *map(str, cells)))
        print_table(("spec", *names) if self._several else names, rows, out)


def named(recording: str, error: str) -> str:
    """An error with its recording, which most errors begin with."""
    return error if error.startswith(recording) else f"{recording}: {error}"


def _second(rows: Sequence[Row]) -> str:
    """The second order in which a recording was judged; empty where there is one."""
    return "arrival" if len({row.order for row in rows}) > 1 else ""


def _name(row: Row, second: str) -> str:
    return f"{row.property} (arrival)" if row.order == second else row.property
