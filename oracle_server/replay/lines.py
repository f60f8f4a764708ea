"""The report of `replay` as JSON Lines, and the verdict records of a step."""

from __future__ import annotations

from typing import IO

import msgspec

from oracle_server.core.kinds import UNAVAILABLE
from oracle_server.core.records import VerdictRecord
from oracle_server.core.revisions import Revision, revision_record
from oracle_server.core.verdicts import UNDECIDED, Judged, record
from oracle_server.replay.conclusion import conclude
from oracle_server.replay.run import Replay


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
        self._write({"summary": replay.summary() | conclude(replay).as_data()})

    def finish(self) -> None:
        """Write nothing more."""

    def _write(self, value: object) -> None:
        self._out.write(msgspec.json.encode(value).decode() + "\n")


def records(replay: Replay, judged: Judged) -> list[VerdictRecord]:
    """The verdict records of a step, with what the adapter did with its event if that is recorded; or of a revision."""
    if isinstance(judged, Revision):
        return [revision_record(judged, change) for change in judged.changes if change is not None]
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
