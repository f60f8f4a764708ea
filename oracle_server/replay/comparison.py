"""What ROSMonitoring's oracle said of recorded events, against what is said now."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from oracle_server.core.events import Event, Order
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome

Meaning = Literal["satisfied", "violated", "unknown"]
"""What an old verdict and ours are compared by."""
_SATISFIED = frozenset({"true", "currently_true"})
_VIOLATED = frozenset({"false", "currently_false", "violation", "violated"})


class Difference(NamedTuple):
    """An event of which something else was said; `properties` are those that are negative now."""

    event: Event
    was: str
    now: Meaning
    properties: tuple[str, ...]

    def as_data(self) -> dict[str, Any]:
        """The difference as plain data."""
        event = self.event
        return {
            "stream": event.stream.name,
            "kind": event.stream.kind,
            "seq": event.seq,
            "stamp": event.stamp,
            "was": self.was,
            "now": self.now,
            "properties": list(self.properties),
        }


class Comparison:
    """Pairs old verdicts with new ones, event by event."""

    def __init__(self, order: Order) -> None:
        """Compare with what is judged in `order`."""
        self.compared = self.differing = 0
        self.found: list[Difference] = []
        """The differences since they were last taken."""
        self._order = order
        self._waiting: dict[tuple[str, int], str] = {}

    @property
    def compares(self) -> bool:
        """Whether something was said of an event that is not judged yet."""
        return bool(self._waiting)

    def told(self, event: Event, verdict: str) -> None:
        """Keep what was said of an event until it is judged."""
        self._waiting[event.monitor, event.seq] = verdict

    def judged(self, judged: Judged) -> None:
        """Compare an event's old verdict, where there is one, with what is said now."""
        event = judged.step.event
        if judged.order != self._order:
            return
        was = self._waiting.pop((event.monitor, event.seq), None)
        if was is None:
            return
        self.compared += 1
        now = _meaning_now(judged)
        if _meaning(was) != now:
            self.differing += 1
            broken = tuple(v.property for v in judged.verdicts if v.outcome in NEGATIVE)
            self.found.append(Difference(event, was, now, broken))

    def take(self) -> list[Difference]:
        """The differences that were found since the last call."""
        found = self.found
        if found:
            self.found = []
        return found

    def summary(self) -> dict[str, int]:
        """The counts, where anything was compared."""
        return {"compared": self.compared, "differing": self.differing} if self.compared else {}


def _meaning(verdict: str) -> Meaning:
    word = verdict.strip().lower()
    return "satisfied" if word in _SATISFIED else "violated" if word in _VIOLATED else "unknown"


def _meaning_now(judged: Judged) -> Meaning:
    outcomes = {verdict.outcome for verdict in judged.verdicts}
    if outcomes & NEGATIVE:
        return "violated"
    return "unknown" if Outcome.UNKNOWN in outcomes else "satisfied"
