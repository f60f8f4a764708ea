"""The report of `replay` as a table of comma-separated values."""

from __future__ import annotations

import csv
from typing import IO

from oracle_server.core.errors import one_line
from oracle_server.core.verdicts import Judged
from oracle_server.replay.lines import records
from oracle_server.replay.run import Replay


def _csv_cell(value: object) -> object:
    """A value that a spreadsheet takes for what it is: it runs a text that begins like a formula."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text[:1] in ("=", "+", "-", "@") else text


class CsvReport:
    """A row for each verdict record, below the names of its fields; times in nanoseconds."""

    def __init__(self, out: IO[str], several: bool) -> None:  # noqa: ARG002 -- a table always has the same columns
        self._out = csv.writer(out)
        self._headed = False

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write the records of a step, and the heading before the first one."""
        for row in records(replay, judged):
            why = row["explanation"]
            values: dict[str, object] = {**row, "explanation": why["text"] if why else None}
            del values["about"]
            if not self._headed:
                self._out.writerow(("spec", *values))
                self._headed = True
            self._out.writerow((replay.spec.id, *map(_csv_cell, values.values())))

    def ended(self, replay: Replay) -> None:
        """Write nothing: the table has no summary."""

    def finish(self) -> None:
        """Write nothing more."""
