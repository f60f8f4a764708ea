"""What is told of a session's episodes once it is committed: that one has begun, has ended, or does not stand."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import msgspec

from oracle_server.core.episode import EpisodeChange
from oracle_server.core.events import Order
from oracle_server.core.judging.judge import Judge
from oracle_server.core.records import ExplanationRecord
from oracle_server.core.verdicts import Judged
from oracle_server.history.episodes import StoredEpisode, going_on, told
from oracle_server.history.records import SessionRecord
from oracle_server.wire.frames import EpisodeEvent, EpisodeFrame

_EVENTS: Mapping[str, EpisodeEvent] = {"begins": "begun", "ends": "ended", "goes": "retracted"}
_MOST = 1_000


def episode_frames(
    record: SessionRecord, row: Judged, explanations: Mapping[int, ExplanationRecord]
) -> list[EpisodeFrame]:
    """The frames of a row of a session, whose explanations are given by the indexes of the properties."""
    return [
        _frame(record, row, change, explanations.get(change.index)) for change in row.episodes if change.kind in _EVENTS
    ]


def _frame(
    record: SessionRecord, row: Judged, change: EpisodeChange, explanation: ExplanationRecord | None
) -> EpisodeFrame:
    text = change.text
    if text is None and change.kind == "begins" and explanation is not None:
        text = explanation["text"]
    stored = StoredEpisode(record.properties[change.index], row.order, change.episode, text)
    made = told(record.id, record.spec, stored)
    return {"type": "episode", "event": _EVENTS[change.kind], "moved": change.moved, **made}


def ended_frames(record: SessionRecord, judges: Mapping[Order, Judge]) -> list[EpisodeFrame]:
    """The frames of the episodes that go on, as they end with their session."""
    frames: list[EpisodeFrame] = []
    for each in going_on(judges, record.properties):
        over = each._replace(episode=msgspec.structs.replace(each.episode, open=False))
        frames.append({"type": "episode", "event": "ended", "moved": False, **told(record.id, record.spec, over)})
    return frames


class EpisodeFeed:
    """The last frames that were committed, for those who follow them."""

    def __init__(self) -> None:
        self.last = 0
        """How many frames there were."""
        self._kept: deque[EpisodeFrame] = deque(maxlen=_MOST)

    def add(self, frames: Sequence[EpisodeFrame]) -> None:
        """Take frames whose rows are committed."""
        self._kept.extend(frames)
        self.last += len(frames)

    def since(self, count: int) -> list[EpisodeFrame] | None:
        """The frames behind so many; None where they are not kept any more."""
        missing = self.last - count
        if missing > len(self._kept):
            return None
        return list(self._kept)[len(self._kept) - missing :]
