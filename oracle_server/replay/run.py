"""Judges a recording by the same core as a live session."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from oracle_server.core.engine import Answer
from oracle_server.core.errors import TraceError
from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.kinds import TICK
from oracle_server.core.plan import plan
from oracle_server.core.ranges import ValueKind
from oracle_server.core.session import Session
from oracle_server.core.spec import By, Spec, orders
from oracle_server.core.typed import StreamTypes
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.engines.table import make_engines
from oracle_server.remote.offline import OfflineOracles
from oracle_server.replay.comparison import Comparison
from oracle_server.replay.coverage import Counting, Coverage, counted_names
from oracle_server.replay.delays import Delays
from oracle_server.replay.lacking import Lacking
from oracle_server.replay.recording import Place, Recorded, Recording
from oracle_server.replay.units import Units
from oracle_server.replay.unjudged import Unjudged

_FOR_EVER = 2**63
_NOT_KEPT = Answer(Outcome.UNKNOWN, "was not asked: a session's trace has no messages, only their signals")


class Replay:
    """Judges a recording by a spec: iterate it for the judged steps, then call `summary`.

    A session's own trace is judged in its recorded order, and with the recorded answers of external oracles, unless
    `by` requests another order.
    """

    def __init__(
        self,
        spec: Spec,
        recording: Recording,
        by: By | None = None,
        *,
        types: StreamTypes = MappingProxyType({}),
        warnings: Sequence[str] = (),
        strict: bool = False,
    ) -> None:
        """`by` overrides the order that the spec asks for; `strict`: whatever was not judged is no success.

        Messages are held against `types`, those of the streams whose types are known; `warnings` are of the formulas.
        """
        self.strict, self.warnings = strict, tuple(warnings)
        ordering = replace(spec.ordering, by=by) if by else spec.ordering
        self.spec = replace(spec, ordering=ordering)
        self.events = 0
        self.forced = 0
        """Steps that were judged before their time, since too many were held."""
        self.comparison = Comparison(orders(self.spec)[0])
        self.units, self.delays = Units(spec), Delays(spec)
        self.passed: dict[tuple[str, int], tuple[bool, str | None]] = {}
        """What an adapter did with the events that are not judged yet: whether they passed, and why."""
        self.recording = recording
        ready = plan(spec)
        self.lacking = Lacking(ready, types)
        self._counting = {
            key: Counting(stream.project, counted_names(spec, key, types.get(key)), types.get(key))
            for key, stream in ready.streams.items()
        }
        streams = {key: replace(stream, project=self._counting[key]) for key, stream in ready.streams.items()}
        self._plan = replace(ready, streams=streams)
        self._unjudged = Unjudged(ready)
        self._reorder = by is not None
        self._session: Session | None = None
        self._oracles: OfflineOracles | None = None

    def __iter__(self) -> Iterator[Judged]:
        """The judged steps, in order. Raises `TraceError` where the recording can't be used."""
        recorded = iter(self.recording)
        first = next(recorded, None)
        if first is None:
            return
        judge = self._in_recorded_order if first.places and not self._reorder else self._as_new
        try:
            for item in judge(first, recorded):
                if self.comparison.is_waiting:
                    self.comparison.compare(item)
                self._unjudged.note(item)
                self.delays.note(item)
                self.forced += item.step.forced
                yield item
        finally:
            if self._oracles is not None:
                self._oracles.close()

    def _as_new(self, first: Recorded, rest: Iterator[Recorded]) -> Iterator[Judged]:
        session = self._session = self._open(first.begun)
        if session.asking is not None:
            self._oracles = OfflineOracles(session)
        monitors: set[str] = set()
        for recorded in itertools.chain((first,), rest):
            event = self._take(recorded)
            if event.stream.kind == TICK:
                continue  # the new session has deadlines of its own
            if event.monitor not in monitors:
                monitors.add(event.monitor)
                yield from self._settled(session.attach(event.monitor, self.spec.by_key, event.arrived))
            yield from self._settled(session.ingest(event))
        yield from self._settled(session.finish(session.now))

    def _settled(self, judged: list[Judged]) -> list[Judged]:
        return judged if self._oracles is None else judged + self._oracles.settle()

    def _in_recorded_order(self, first: Recorded, rest: Iterator[Recorded]) -> Iterator[Judged]:
        """Judge steps by their recorded positions, each once all events that arrived before it are read."""
        used = {place.order for place in first.places}
        ordering = replace(self.spec.ordering, by="both" if len(used) > 1 else used.pop())
        self.spec = replace(self.spec, ordering=ordering)
        session = self._session = self._open(first.begun)
        waiting: list[tuple[int, Place, Step]] = []
        upcoming = itertools.count(1)
        for recorded in itertools.chain((first,), rest):
            event = self._take(recorded)
            while waiting and waiting[0][1].judged < event.arrived:
                yield from _rejudge(session, next(upcoming), *heapq.heappop(waiting))
            signals, failed = _project(session, event)
            step = Step(event, signals, failed, event.stamp or event.arrived)
            for place in recorded.places:
                heapq.heappush(waiting, (place.position, place, step))
        while waiting:
            yield from _rejudge(session, next(upcoming), *heapq.heappop(waiting))

    def _take(self, recorded: Recorded) -> Event:
        event = recorded.event
        if event.stream.kind != TICK:
            self.events += 1
            self.lacking.look(recorded)
            if self.recording.clocked:
                self.units.look(recorded)
        if recorded.passed is not None:
            self.passed[event.monitor, event.seq] = (recorded.passed, recorded.why)
        if recorded.verdict is not None:
            self.comparison.expect(event, recorded.verdict)
        return event

    def _open(self, begun: int | None) -> Session:
        """A new session, which began at a time (ns) or else begins with its first monitor.

        Without times of arrival, it has no delays, no limit on skew, and no ticks.
        """
        spec = self.spec
        if not self.recording.clocked:
            ordering = replace(spec.ordering, max_delay=None, max_skew=_FOR_EVER, capacity=_FOR_EVER)
            spec = replace(spec, ordering=ordering)
        ready = replace(self._plan, spec=spec)
        return Session(ready, make_engines(ready), ticking=self.recording.clocked, begun=begun)

    @property
    def session(self) -> Session | None:
        """The session in which the recording was judged, None before its first event."""
        return self._session

    @property
    def unjudged(self) -> dict[str, tuple[StreamKey, ...]]:
        """The properties that were not judged, with the streams where they were not; none where there was no step.

        No streams: they were unknown at every step.
        """
        return self._unjudged.found() if self.events else {}

    @property
    def coverage(self) -> Coverage:
        """The events and signals of each stream."""
        return {key: counting.counts() for key, counting in self._counting.items()}

    def kinds(self, stream: StreamKey, signal: str) -> frozenset[ValueKind]:
        """What kinds of values a signal of a stream had."""
        return self._counting[stream].kinds(signal)

    @property
    def skipped(self) -> int:
        """The events that were late and not judged, in the order that had most of them."""
        counters = [judge.counters for judge in self._session.judges.values()] if self._session else []
        return max((c.skipped for c in counters), default=0)

    @property
    def violated(self) -> frozenset[str]:
        """The properties that became negative, in any order."""
        judges = self._session.judges.values() if self._session else ()
        return frozenset(s.property.id for judge in judges for s in judge.properties if s.violations)

    def summary(self) -> dict[str, Any]:
        """The counts of the whole run, and the state of each property at its end.

        With both orders, a property judged by arrival is listed as `name (arrival)`.
        """
        states = self.states()
        counters = [judge.counters for judge in self._session.judges.values()] if self._session else []
        summary = {
            "spec": self.spec.id,
            "events": self.events,
            "ignored": sum(self.recording.ignored.values()),
            "violations": sum(state["violations"] for state in states.values()),
            "late": sum(c.late for c in counters),
            "properties": states,
        }
        return summary | self.comparison.summary()

    def states(self) -> dict[str, dict[str, Any]]:
        """The state of each property."""
        if self._session is None:
            blank = {"outcome": "unknown", "first_violation": None, "violations": 0, "unknown": 0}
            blank |= {"first_violation_step": None, "first_violation_at": None}
            return {p.id: dict(blank) for p in self.spec.properties}
        both = len(self._session.judges) > 1
        return {
            state.property.id + (" (arrival)" if both and order == "arrival" else ""): {
                "outcome": state.outcome.value,
                "first_violation": state.first_violation,
                "first_violation_step": state.first_violation_step,
                "first_violation_at": state.first_violation_at,
                "violations": state.violations,
                "unknown": state.failures,
            }
            for order, judge in self._session.judges.items()
            for state in judge.properties
        }


def _project(session: Session, event: Event) -> tuple[Mapping[str, Scalar], frozenset[str]]:
    if event.stream.kind == TICK:
        return {}, frozenset()
    return session.plan.streams[event.stream].project(event.data)


def _rejudge(session: Session, upcoming: int, position: int, place: Place, step: Step) -> list[Judged]:
    if upcoming == 1 and position > 1:
        raise TraceError(
            f"the session's first steps are not in the recording, which begins with step {position}, so that its "
            "verdicts would differ; use --by to judge the recorded events afresh"
        )
    if place.degraded:
        session.judges[place.order].degrade()
    bypassed = [i for i, p in enumerate(session.plan.spec.properties) if p.id in place.bypassed]
    session.judges[place.order].bypass(bypassed)
    for index in session.plan.external:
        session.receive(place.order, {index: place.said.get(session.plan.spec.properties[index].id, _NOT_KEPT)})
    placed = Step(
        step.event, step.signals, step.failed, step.stamp, place.skewed, place.late, place.forced, place.skipped
    )
    judged = session.rejudge(place.order, placed, place.judged)
    return [] if judged is None else [judged]
