"""The report of `replay` as text, for people."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

from oracle_server.core.errors import one_line
from oracle_server.core.naming import first_name, retraction_text
from oracle_server.core.units import counted
from oracle_server.core.verdicts import Judged
from oracle_server.process.tables import print_table
from oracle_server.replay.conclusion import conclude, still_open
from oracle_server.replay.doubts.coverage import Coverage, because
from oracle_server.replay.report.lines import retractions, violations
from oracle_server.replay.run import Replay


class TextReport:
    """Violations and differences as they occur, then a table for each spec."""

    def __init__(self, out: IO[str], several: bool, *, signals: bool = False) -> None:
        self._out, self._several, self._signals = out, several, signals

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write violations, and differences from recorded verdicts."""
        order = " by arrival" if judged.order == "arrival" else ""
        for row, text in violations(judged):
            self._write(replay, f"violation{order}: {one_line(text)} (#{row['n']})")
        for row in retractions(judged):
            self._write(replay, f"retracted: {one_line(retraction_text(row))} (#{row['n']})")
        self._differences(replay)

    def _differences(self, replay: Replay) -> None:
        for found in replay.comparison.take():
            broken = f" ({', '.join(found.properties)})" if found.properties else ""
            event = f"{found.event.stream} {found.event.seq}"
            self._write(replay, f"difference: {event} was '{one_line(found.was)}', is {found.now}{broken}")

    def ended(self, replay: Replay) -> None:
        """Write a table of the properties, and the counts."""
        self._differences(replay)
        summary = replay.summary()
        rows = [
            (name, state["outcome"], str(state["violations"]), first_name(state), str(state["unknown"]))
            for name, state in summary["properties"].items()
        ]
        if self._several:
            self._out.write(f"== {replay.spec.id}\n")
        print_table(("property", "outcome", "violations", "first at", "unknown"), rows, self._out)
        counts = f"{counted(summary['events'], 'event')}, {counted(summary['violations'], 'violation')}"
        counts += f", {summary['late']} late"
        if "compared" in summary:
            counts += f"; {summary['compared']} compared with old verdicts, {summary['differing']} differ"
        self._out.write(f"{counts}\n")
        end = conclude(replay)
        if self._signals:
            print_table(_SIGNALS, list(_signals(end.coverage)), self._out)
        lines = [*still_open(replay), *(f"{name} was not judged: {reason}" for name, reason in end.unjudged.items())]
        for line in (*lines, *end.doubts, *end.remarks, *_failures(end.coverage)):
            self._write(replay, one_line(line))

    def finish(self, why: str = "") -> None:
        """Write nothing more."""

    def _write(self, replay: Replay, line: str) -> None:
        self._out.write(f"{replay.spec.id}: {line}\n" if self._several else f"{line}\n")


_SIGNALS = ("stream", "events", "signal", "present", "absent", "failed")


def _signals(coverage: Coverage) -> Iterator[tuple[str, ...]]:
    """How often each signal was present, absent and failed."""
    for key, counts in coverage.items():
        yield str(key), str(counts["events"]), "", "", "", ""
        for name, signal in counts["signals"].items():
            yield "", "", name, str(signal["present"]), str(signal["absent"]), str(signal["failed"])


def _failures(coverage: Coverage) -> list[str]:
    """The signals that failed at some events; those that were never there are said elsewhere."""
    return [
        f"{key}: the signal {name} failed at {signal['failed']} of {counted(counts['events'], 'event')}"
        + because(signal)
        for key, counts in coverage.items()
        for name, signal in counts["signals"].items()
        if signal["failed"] and signal["present"]
    ]
