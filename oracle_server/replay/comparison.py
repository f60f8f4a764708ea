"""Compares recorded verdicts of ROSMonitoring's oracle with the replay's verdicts."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

from oracle_server.core.events import Event, Order
from oracle_server.core.verdicts import NEGATIVE, Judged, Outcome

Meaning = Literal["satisfied", "violated", "unknown"]
"""The meaning of a verdict, by which both are compared."""
_SATISFIED = frozenset({"true", "currently_true"})
_VIOLATED = frozenset({"false", "currently_false", "violation", "violated"})


class Difference(NamedTuple):
    """An event with another verdict than recorded; `properties` are those that are negative now."""

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
    """Compares the recorded verdict of each event with its new one."""

    def __init__(self, order: Order) -> None:
        """Compare with the verdicts of one order."""
        self.compared = self.differing = 0
        self.found: list[Difference] = []
        """The differences since the last call of `take`."""
        self._order = order
        self._waiting: dict[tuple[str, int], str] = {}

    @property
    def is_waiting(self) -> bool:
        """Whether the recorded verdict of an event waits for the new one."""
        return bool(self._waiting)

    def expect(self, event: Event, verdict: str) -> None:
        """Keep the recorded verdict of an event until it is judged."""
        self._waiting[event.monitor, event.seq] = verdict

    def compare(self, judged: Judged) -> None:
        """Compare the verdicts of a judged event with its recorded verdict, if there is one."""
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
        """Return the differences since the last call."""
        found = self.found
        if found:
            self.found = []
        return found

    def summary(self) -> dict[str, int]:
        """The counts; empty where nothing was compared."""
        return {"compared": self.compared, "differing": self.differing} if self.compared else {}


def _meaning(verdict: str) -> Meaning:
    word = verdict.strip().lower()
    return "satisfied" if word in _SATISFIED else "violated" if word in _VIOLATED else "unknown"


def _meaning_now(judged: Judged) -> Meaning:
    outcomes = {verdict.outcome for verdict in judged.verdicts}
    if outcomes & NEGATIVE:
        return "violated"
    return "unknown" if Outcome.UNKNOWN in outcomes else "satisfied"
