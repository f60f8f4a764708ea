"""Which properties a recording says nothing of: those that were unknown wherever it could have told something."""

from __future__ import annotations

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.kinds import TICK
from oracle_server.core.plan import Plan
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.replay.doubts.coverage import signal_names


class Unjudged:
    """Notes what was judged, and tells which properties were not.

    A property that reads signals of a stream has to be judged at one of its events that has any of them: at the events
    of other streams, and at those without the signals, it may hold for want of them.
    """

    def __init__(self, ready: Plan) -> None:
        """Begin with nothing judged."""
        self._plan = ready
        self._properties = ready.spec.properties
        self._never = {prop.id for prop in self._properties}
        """Those that were unknown at every step."""
        self._numeric = {prop.id for prop in self._properties if prop.numeric}
        self.begun: dict[str, int] = {}
        """Formulas over numbers that were unknown at first, each with the number of the first step that was judged."""
        self._own = {key: frozenset(signal_names(ready.spec, key)) for key in ready.streams}
        self._waiting: dict[tuple[Order, StreamKey], dict[int, bool]] = {}
        """By order and stream the properties, by index, that were not judged there; and whether they were unknown."""

    def note(self, judged: Judged) -> None:
        """Note a judged step."""
        for verdict in judged.verdicts if self._never else ():
            if verdict.outcome is not Outcome.UNKNOWN and verdict.property in self._never:
                self._never.discard(verdict.property)
                if verdict.property in self._numeric and (judged.number or 0) > 1:
                    self.begun[verdict.property] = judged.number or 0
        stream = judged.step.event.stream
        if stream.kind == TICK:
            return
        waiting = self._waiting.get((judged.order, stream))
        if waiting is None:
            waiting = self._waiting[judged.order, stream] = dict.fromkeys(self._readers(stream), False)
        for index in list(waiting):
            if judged.verdicts[index].outcome is Outcome.UNKNOWN:
                waiting[index] = True
            elif self._has_any(stream, index, judged):
                del waiting[index]

    def found(self) -> dict[str, tuple[StreamKey, ...]]:
        """The properties that were not judged, with the streams at all of whose events they were unknown, or vacuous.

        There is none where a property was unknown at every step.
        """
        streams: dict[str, list[StreamKey]] = {}
        for (_, stream), waiting in self._waiting.items():
            for index in (i for i, was_unknown in waiting.items() if was_unknown):
                streams.setdefault(self._properties[index].id, []).append(stream)
        return {
            prop.id: () if prop.id in self._never else tuple(dict.fromkeys(streams[prop.id]))
            for prop in self._properties
            if prop.id in self._never or prop.id in streams
        }

    def _readers(self, stream: StreamKey) -> list[int]:
        """The properties that read signals at a stream's events, and are judged there whatever else is missing."""
        views = self._plan.streams[stream].views
        return [i for i, p in enumerate(self._properties) if views[i].reads and not p.numeric and not p.external]

    def _has_any(self, stream: StreamKey, index: int, judged: Judged) -> bool:
        """Whether an event has any of its own signals that a property reads there; true where it reads others only."""
        own = self._plan.streams[stream].views[index].reads & self._own[stream]
        return not own or not own.isdisjoint(judged.step.signals)
