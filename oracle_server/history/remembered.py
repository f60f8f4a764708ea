"""What a history in memory keeps of one session."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field
from operator import attrgetter

import msgspec

from oracle_server.core.ordering.numbering import Numbering
from oracle_server.history.episodes import KeptEpisodes
from oracle_server.history.records import (
    Document,
    MonitorRecord,
    Refusal,
    Restated,
    SessionRecord,
    SnapshotRecord,
    StoredStep,
)
from oracle_server.history.steps import plain_whys

STEP = 1_000
"""Bytes that a step is taken to need."""
_REFUSAL = 200
_REST = 1_000
"""Bytes that a refused event is taken to need, and a session beside its spec."""


@dataclass(slots=True)
class Kept:
    """All that is kept of one session."""

    record: SessionRecord
    closed: int | None = None
    state: Document | None = None
    steps: list[StoredStep] = field(default_factory=list)
    monitors: dict[str, MonitorRecord] = field(default_factory=dict)
    refusals: list[Refusal] = field(default_factory=list)
    snapshot: SnapshotRecord | None = None
    episodes: KeptEpisodes = field(default_factory=KeptEpisodes)

    @property
    def beside(self) -> int:
        """Bytes that it is taken to need beside its steps."""
        return _REST + len(self.record.text) + len(self.refusals) * _REFUSAL

    def index(self, position: int) -> int:
        """Where the step at a position, or the next one, stands in `steps`."""
        return bisect_left(self.steps, position, key=attrgetter("position"))

    def restate(self, position: int, stands: Restated) -> None:
        """Keep what stands of the step at a position, if it is not deleted."""
        index = self.index(position)
        if index < len(self.steps) and (step := self.steps[index]).position == position:
            standing = msgspec.structs.replace(stands.standing, explanations=plain_whys(stands.standing.explanations))
            revised = {**step.revised, **stands.revised}
            self.steps[index] = msgspec.structs.replace(step, standing=standing, revised=revised)

    def forget_refused(self, keep: int) -> int:
        """Delete refused events but the last `keep`, and those that a start needs; returns how many these are."""
        numbers = (self.snapshot and self.snapshot.numbers) or {}
        upto = {monitor: Numbering((), saved).upto for monitor, saved in numbers.items()}
        end = max(0, len(self.refusals) - keep)
        needed = [refusal for refusal in self.refusals[:end] if refusal.seq > upto.get(refusal.monitor, 0)]
        self.refusals[:end] = needed
        return len(needed)
