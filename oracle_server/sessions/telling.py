"""What monitors are told of a row once it is committed: violations, what was revised, and episodes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from oracle_server.core.revisions import Revision, revision_record
from oracle_server.core.verdicts import Judged, record
from oracle_server.sessions.monitor import Monitor
from oracle_server.wire.frames import EpisodeFrame, RevisionFrame, ViolationFrame

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


def tell(monitors: Iterable[Monitor], frames: Iterable[News], episodes: Sequence[EpisodeFrame] = ()) -> None:
    """Send frames to the monitors that are connected: of revisions and episodes to the ones that requested them.

    Who is told of episodes is told of no violations.
    """
    for monitor in monitors:
        if not monitor.outbox:
            continue
        for frame in frames:
            if monitor.revisions if frame["type"] == "revision" else not monitor.episodes:
                monitor.outbox.send(frame)
        if monitor.episodes:
            for each in episodes:
                monitor.outbox.send(each)
