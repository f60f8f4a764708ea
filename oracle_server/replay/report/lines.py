"""The report of `replay` as JSON Lines, and the verdict records of a step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import IO

import msgspec

from oracle_server.core.kinds import UNAVAILABLE
from oracle_server.core.records import VerdictRecord
from oracle_server.core.verdicts import UNDECIDED, Judged, record
from oracle_server.replay.conclusion import conclude
from oracle_server.replay.run import Replay
from oracle_server.replay.settling import Settled


class JsonReport:
    """A line for each verdict record and difference, and a summary for each spec."""

    def __init__(self, out: IO[str], several: bool) -> None:
        self._out, self._several = out, several

    def judged(self, replay: Replay, judged: Judged) -> None:
        """Write the records of a step."""
        for row in records(replay, judged):
            self._write({"spec": replay.spec.id} | row if self._several else row)
        self._differences(replay)

    def _differences(self, replay: Replay) -> None:
        for found in replay.comparison.take():
            self._write({"difference": {"spec": replay.spec.id} | found.as_data()})

    def ended(self, replay: Replay) -> None:
        """Write the summary."""
        self._differences(replay)
        self._write({"summary": replay.summary() | conclude(replay).as_data()})

    def finish(self, why: str = "") -> None:
        """Write nothing more."""

    def _write(self, value: object) -> None:
        self._out.write(msgspec.json.encode(value).decode() + "\n")


def violations(judged: Judged) -> Iterator[tuple[VerdictRecord, str]]:
    """The records of the violations that are told of a step, each with its text."""
    if isinstance(judged, Settled):
        rows = [row for row in judged.told if row["violation"]]
    else:
        rows = [record(judged, verdict) for verdict in judged.verdicts if verdict.explanation]
    for row in rows:
        if row["explanation"]:
            yield row, row["explanation"]["text"]


def retractions(judged: Judged) -> list[VerdictRecord]:
    """The records of a revision by which a violation does not stand."""
    return [row for row in judged.told if row.get("retracted")] if isinstance(judged, Settled) else []


def records(replay: Replay, judged: Judged) -> list[VerdictRecord]:
    """The verdict records of a step, with what the adapter did with its event if that is recorded."""
    if isinstance(judged, Settled):
        return list(judged.told)
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
