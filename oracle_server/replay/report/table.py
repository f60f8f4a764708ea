"""The report of `replay` as a table of comma-separated values."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from typing import IO

from oracle_server.core.errors import one_line
from oracle_server.core.naming import cause_name
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import Judged
from oracle_server.replay.report.lines import records
from oracle_server.replay.run import Replay

SPREADSHEET = ("=", "+", "-", "@")
"""What formulas of spreadsheets begin with."""


def csv_cell(value: object) -> object:
    """A value that a spreadsheet takes for what it is: it runs a text that begins like a formula."""
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str):
        return value
    text = one_line(value)
    return f"'{text}" if text[:1] in SPREADSHEET else text


_COLUMNS = tuple(name for name in VerdictRecord.__annotations__ if name not in ("unheard", "waited", "causes", "about"))
"""The fields that records of a replay may have; `because` tells how many causes there are."""


def _csv_row(row: VerdictRecord) -> Iterator[object]:
    """What stands in the columns of a record; of what is several values, a text."""
    values: dict[str, object] = {**row}
    if why := row["explanation"]:
        values["explanation"] = why["text"]
    if "revises" in row:
        values["revises"] = f"{row['revises']['from']} to {row['revises']['to']}"
        values["because"] = cause_name(row)
    return (csv_cell(values.get(name)) for name in _COLUMNS)


class CsvReport:
    """A row for each verdict record, below the names of its fields; times in nanoseconds."""

    def __init__(self, out: IO[str], several: bool) -> None:  # noqa: ARG002 -- a table always has the same columns
        self._out = csv.writer(out)
        self._headed = False

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write the records of a step, and the heading before the first one."""
        for row in records(replay, judged):
            if not self._headed:
                self._out.writerow(("spec", *_COLUMNS))
                self._headed = True
            self._out.writerow((replay.spec.id, *_csv_row(row)))

    def ended(self, replay: Replay) -> None:
        """Write nothing: the table has no summary."""

    def finish(self, why: str = "") -> None:
        """Write nothing more."""
