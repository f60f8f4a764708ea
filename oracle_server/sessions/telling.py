"""What monitors are told of a row once it is committed: violations, and what was revised."""

from __future__ import annotations

from collections.abc import Iterable

from oracle_server.core.revisions import Revision, revision_record
from oracle_server.core.verdicts import Judged, record
from oracle_server.sessions.monitor import Monitor
from oracle_server.wire.frames import RevisionFrame, ViolationFrame

News = ViolationFrame | RevisionFrame


def news(row: Judged) -> list[News]:
    """The frames of a row: a `violation` for each property that becomes negative by it, a `revision` for each change.

    A change by which a violation appears is both.
    """
    if not isinstance(row, Revision):
        return [{"type": "violation", **record(row, v)} for v in row.verdicts if v.explanation]
    found: list[News] = []
    for change in row.changes:
        if change is not None:
            made = revision_record(row, change)
            found.append({"type": "revision", **made})
            if change.violation:
                found.append({"type": "violation", **made})
    return found


def for_log(frames: Iterable[News]) -> list[News]:
    """The frames that the log has a line for: violations, and revisions that take one back."""
    return [frame for frame in frames if frame["type"] == "violation" or frame.get("retracted")]


def tell(monitors: Iterable[Monitor], frames: Iterable[News]) -> None:
    """Send frames to the monitors that are connected; those of revisions to the ones that requested them."""
    for frame in frames:
        for monitor in monitors:
            if monitor.outbox and (frame["type"] == "violation" or monitor.revisions):
                monitor.outbox.send(frame)
