"""The reports of `replay`: text, JSON Lines, CSV, and JUnit XML for continuous integration."""

from __future__ import annotations

import csv
from collections import defaultdict
from collections.abc import Callable
from typing import IO, Any, Literal, Protocol
from xml.sax.saxutils import escape, quoteattr

import msgspec
from rich.console import Console
from rich.table import Table

from oracle_server.core.errors import one_line
from oracle_server.core.kinds import UNAVAILABLE
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import UNDECIDED, Judged, explain, record
from oracle_server.replay.run import Replay

Format = Literal["text", "jsonl", "csv", "junit"]
_MOST_SHOWN = 20
"""Violations of one property that a JUnit report explains; all are counted."""


class Report(Protocol):
    """Writes a report of replays, one after the other."""

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Add a judged step."""
        ...

    def ended(self, replay: Replay) -> None:
        """Add the summary of a replay that has ended."""
        ...

    def finish(self) -> None:
        """End the report."""
        ...


def make_report(form: Format, out: IO[str], *, several: bool) -> Report:
    """A report that is written to `out`; with `several` specs, each record names its spec."""
    kinds: dict[Format, Callable[[IO[str], bool], Report]] = {
        "text": TextReport,
        "jsonl": JsonReport,
        "csv": CsvReport,
        "junit": JunitReport,
    }
    return kinds[form](out, several)


class TextReport:
    """Violations and differences as they occur, then a table for each spec."""

    def __init__(self, out: IO[str], several: bool) -> None:
        self._out, self._several = out, several

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write violations, and differences from recorded verdicts."""
        for verdict in judged.verdicts:
            why = explain(judged, verdict)
            if why is not None:
                order = " by arrival" if judged.order == "arrival" else ""
                text = one_line(why["text"])
                self._write(replay, f"violation {verdict.n}{order}: {text}")
        for found in replay.comparison.take():
            broken = f" ({', '.join(found.properties)})" if found.properties else ""
            event = f"{found.event.stream} {found.event.seq}"
            self._write(replay, f"difference: {event} was '{one_line(found.was)}', is {found.now}{broken}")

    def ended(self, replay: Replay) -> None:
        """Write a table of the properties, and the counts."""
        summary = replay.summary()
        table = Table("property", "outcome", "violations", "first at", "unknown", box=None, pad_edge=False)
        for name, state in summary["properties"].items():
            cells = (state["outcome"], state["violations"], state["first_violation"] or "-", state["unknown"])
            table.add_row(name, *map(str, cells))
        console = Console(file=self._out, highlight=False, width=None if self._out.isatty() else 160)
        if self._several:
            console.print(f"== {replay.spec.id}")
        console.print(table)
        counts = f"{summary['events']} events, {summary['violations']} violations, {summary['late']} late"
        if "compared" in summary:
            counts += f"; {summary['compared']} compared with old verdicts, {summary['differing']} differ"
        console.print(counts)

    def finish(self) -> None:
        """Write nothing more."""

    def _write(self, replay: Replay, line: str) -> None:
        self._out.write(f"{replay.spec.id}: {line}\n" if self._several else f"{line}\n")


class JsonReport:
    """A line for each verdict record and difference, and a summary for each spec."""

    def __init__(self, out: IO[str], several: bool) -> None:
        self._out, self._several = out, several

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write the records of a step."""
        for row in records(replay, judged):
            self._write({"spec": replay.spec.id} | row if self._several else row)
        for found in replay.comparison.take():
            self._write({"difference": {"spec": replay.spec.id} | found.as_data()})

    def ended(self, replay: Replay) -> None:
        """Write the summary."""
        self._write({"summary": replay.summary()})

    def finish(self) -> None:
        """Write nothing more."""

    def _write(self, value: object) -> None:
        self._out.write(msgspec.json.encode(value).decode() + "\n")


class CsvReport:
    """A row for each verdict record, below the names of its fields; times in nanoseconds."""

    def __init__(self, out: IO[str], several: bool) -> None:  # noqa: ARG002 -- a table always has the same columns
        self._out = csv.writer(out)
        self._headed = False

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write the records of a step, and the heading before the first one."""
        for row in records(replay, judged):
            if not self._headed:
                self._out.writerow(("spec", *row))
                self._headed = True
            why = row["explanation"]
            values: dict[str, object] = {**row, "explanation": why["text"] if why else None}
            cells = (str(value).lower() if isinstance(value, bool) else value for value in values.values())
            self._out.writerow((replay.spec.id, *cells))

    def ended(self, replay: Replay) -> None:
        """Write nothing: the table has no summary."""

    def finish(self) -> None:
        """Write nothing more."""


class JunitReport:
    """A test suite for each spec, a test case for each property: a failure if violated, an error if unknown."""

    def __init__(self, out: IO[str], several: bool) -> None:  # noqa: ARG002 -- a suite always has its name
        self._out = out
        self._texts: defaultdict[str, list[str]] = defaultdict(list)
        self._suites: list[str] = []

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Keep the explanations of the first violations."""
        both = replay.spec.ordering.by == "both" and judged.order == "arrival"
        for verdict in judged.verdicts:
            texts = self._texts[verdict.property + (" (arrival)" if both else "")]
            why = explain(judged, verdict)
            if why is not None and len(texts) < _MOST_SHOWN:
                texts.append(why["text"])
        replay.comparison.take()

    def ended(self, replay: Replay) -> None:
        """Add a suite."""
        cases = [self._case(replay, name, state) for name, state in replay.states().items()]
        wrong = {kind: sum(f"<{kind} " in case for case in cases) for kind in ("failure", "error", "skipped")}
        counts = f'failures="{wrong["failure"]}" errors="{wrong["error"]}" skipped="{wrong["skipped"]}"'
        head = f'  <testsuite name={_attribute(replay.spec.id)} tests="{len(cases)}" {counts}>\n'
        self._suites.append(head + "".join(cases) + "  </testsuite>\n")
        self._texts.clear()

    def finish(self) -> None:
        """Write all suites."""
        self._out.write('<?xml version="1.0" encoding="UTF-8"?>\n<testsuites>\n')
        self._out.write("".join(self._suites))
        self._out.write("</testsuites>\n")

    def _case(self, replay: Replay, name: str, state: dict[str, Any]) -> str:
        head = f"    <testcase classname={_attribute(replay.spec.id)} name={_attribute(name)}"
        inside = ""
        if state["violations"]:
            message = f"violated {state['violations']} times, first at verdict {state['first_violation']}"
            texts = "\n".join(escape(one_line(text)) for text in self._texts[name])
            inside = f"      <failure message={_attribute(message)}>{texts}</failure>\n"
        elif not replay.events:
            inside = '      <skipped message="no event was judged"/>\n'
        elif state["unknown"]:
            message = f"{state['unknown']} steps could not be judged"
            inside = f"      <error message={_attribute(message)}/>\n"
        return f"{head}>\n{inside}    </testcase>\n" if inside else f"{head}/>\n"


def records(replay: Replay, judged: Judged) -> list[VerdictRecord]:
    """The verdict records of a step, with what the adapter did with its event if that is recorded."""
    rows = [record(judged, verdict) for verdict in judged.verdicts]
    event = judged.step.event
    if not replay.passed or not judged.decision:
        return rows
    passed, why = replay.passed.pop((event.monitor, event.seq), (None, None))
    for row in rows:
        row["passed"] = passed
        if why in UNDECIDED:
            row["kind"] = UNAVAILABLE
    return rows


def _attribute(text: str) -> str:
    return quoteattr(one_line(text))
