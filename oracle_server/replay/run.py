"""Judges a recording by the same core as a live session."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from oracle_server.core.errors import TraceError
from oracle_server.core.events import By, Event, Step, StreamKey
from oracle_server.core.formula.tree import Bound, Next, Pre, Scalar, walk
from oracle_server.core.kinds import TICK
from oracle_server.core.plan import plan
from oracle_server.core.ranges import ValueKind
from oracle_server.core.revise.judge import RevisingJudge
from oracle_server.core.session import Session
from oracle_server.core.spec import Property, Spec, orders
from oracle_server.core.typed import StreamTypes
from oracle_server.core.units import counted
from oracle_server.core.verdicts import Judged
from oracle_server.engines.table import make_engines
from oracle_server.history.views import View
from oracle_server.remote.offline import OfflineOracles
from oracle_server.replay.again import Again
from oracle_server.replay.comparison import Comparison
from oracle_server.replay.doubts.apart import Apart
from oracle_server.replay.doubts.coverage import Counting, Coverage, counted_names
from oracle_server.replay.doubts.delays import Delays
from oracle_server.replay.doubts.lacking import Lacking
from oracle_server.replay.doubts.leaps import Leaps
from oracle_server.replay.doubts.rownames import RowNames
from oracle_server.replay.doubts.spelling import FieldSpelling, Spelling
from oracle_server.replay.doubts.units import Units
from oracle_server.replay.doubts.unjudged import Unjudged
from oracle_server.replay.doubts.vocabulary import Vocabulary
from oracle_server.replay.episodes import Episodes
from oracle_server.replay.lastdeadline import LastDeadline
from oracle_server.replay.recording import Place, Projected, Recorded, Recording
from oracle_server.replay.settling import Handling, Settling

_FOR_EVER = 2**63
_OF_ANOTHER = (
    "does not tell where the session judged it, as the first line does: the recording is put together of several, or "
    "was changed; give each alone, or use --by to judge the recorded events afresh"
)


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
        view: View = "standing",
    ) -> None:
        """`by` overrides the order that the spec asks for; `strict`: whatever was not judged is no success.

        `view`: which verdicts are told where the spec revises; what stands at the end is what counts.

        Messages are held against `types`, those of the streams whose types are known; `warnings` are of the formulas.
        """
        self.strict, self.warnings = strict, tuple(warnings)
        self.spec, self.asked_by = in_order(spec, by), spec.ordering.by
        self.events = 0
        self._last: tuple[str, int] | None = None
        self.forced = 0
        """Steps that were judged before their time, since too many were held."""
        self.comparison = Comparison(orders(self.spec)[0])
        self.units, self.delays, self.leaps = Units(spec), Delays(spec), Leaps()
        self.passed: dict[tuple[str, int], tuple[bool, str | None]] = {}
        """What an adapter did with the events that are not judged yet: whether they passed, and why."""
        self.recording = recording
        ready = plan(spec)
        self.apart, self.vocabulary = Apart(spec), Vocabulary(spec, types)
        self.lacking, self.spelling = Lacking(ready, types), Spelling(spec)
        self.fields, self.row_names = FieldSpelling(spec), RowNames(spec)
        self._counting = {
            key: Counting(stream.project, counted_names(spec, key, types.get(key)), types.get(key))
            for key, stream in ready.streams.items()
        }
        streams = {key: replace(stream, project=self._counting[key]) for key, stream in ready.streams.items()}
        self._plan = replace(ready, streams=streams)
        self._unjudged, self._last_deadline = Unjudged(ready), LastDeadline(self.spec.ordering)
        self._reorder = by is not None
        self._session: Session | None = None
        names = tuple(prop.id for prop in spec.properties)
        self.episodes = Episodes(names)
        self._settling = Settling(names, view, self._changeable, self._handling, self._note)
        self._oracles: OfflineOracles | None = None

    def __iter__(self) -> Iterator[Judged]:
        """The judged steps, in order, as `view` has them where the spec revises. Raises `TraceError` as `outputs`."""
        groups = self.outputs()
        if self.revises:
            yield from self._settling.told(groups)
            return
        for judged in itertools.chain.from_iterable(groups):
            self._note(judged)
            yield judged

    def outputs(self) -> Iterator[list[Judged]]:
        """What the session gives as the recording goes on, revisions included; what belongs together is in one list.

        Raises `TraceError` where the recording can't be used.
        """
        recorded = iter(self.recording)
        first = next(recorded, None)
        if first is None:
            return
        judge = self._in_recorded_order if first.places and not self._reorder else self._as_new
        try:
            yield from self.episodes.follow(judge(first, recorded))
        finally:
            if self._oracles is not None:
                self._oracles.close()

    def _note(self, judged: Judged) -> None:
        """Note what stands of a step at the end."""
        if self.comparison.is_waiting:
            self.comparison.compare(judged)
        self._unjudged.note(judged)
        self.delays.note(judged)
        self.apart.look(judged.step.event)
        self.vocabulary.look(judged.step)
        self.spelling.look(judged.step.event.stream, judged.step.signals)
        self.forced += judged.step.forced

    @property
    def revises(self) -> bool:
        """Whether what comes late puts the verdicts right."""
        return self.spec.ordering.late == "revise"

    def _changeable(self) -> Set[int] | None:
        return None if self._session is None else changeable(self._session)

    def _handling(self, judged: Judged) -> Handling | None:
        """What the adapter did with an event, where that is recorded."""
        event = judged.step.event
        found = self.passed.pop((event.monitor, event.seq), None) if judged.decision else None
        return None if found is None else (found[0], found[1] or "decision")

    def _as_new(self, first: Recorded, rest: Iterator[Recorded]) -> Iterator[list[Judged]]:
        arrived = first.event.arrived
        since = min(self.recording.since or arrived, arrived)
        self.leaps.look(since)
        session = self._session = self._open(since if first.begun is None else first.begun)
        if session.asking is not None:
            self._oracles = OfflineOracles(session)
        counting = {i for i, prop in enumerate(self.spec.properties) if _counts_steps(prop)}
        unread = frozenset[int]().union(*(self.readers(n.unread) | counting for n in self.recording.notes if n.unread))
        for judge in session.judges.values():  # their verdicts may be wrong for want of what can't be read
            judge.bypass(unread)
        if first.event.lost:
            session.note_loss()
        for judged in _meanwhile(session, arrived):  # it may go on for long before an event that the spec observes
            yield self._answered(judged)
        monitors: set[str] = set()
        for recorded in itertools.chain((first,), rest):
            event = self._take(recorded)
            if self.recording.clocked:
                self._last_deadline.note(recorded)
            if event.stream.kind == TICK:
                continue  # the new session has deadlines of its own
            self.leaps.look(event.arrived)
            if event.monitor not in monitors:
                monitors.add(event.monitor)
                yield self._answered(session.attach(event.monitor, self.spec.by_key, event.arrived))
            if self.revises:  # what came late is put in its place before the next event
                yield from _meanwhile(session, event.arrived)
            yield self._answered(session.ingest(event))
        yield from self._end(session)

    def _end(self, session: Session) -> Iterator[list[Judged]]:
        """End a session with its recording, which may go on for long after the last event that the spec observes."""
        until = max(session.now, self.recording.until, self._last_deadline.until)
        self.leaps.look(self.recording.until)
        if self.recording.lost:
            session.note_loss()
        for judged in _meanwhile(session, until):
            yield self._answered(judged)
        for judged in self._last_deadline.settle(session):
            yield self._answered(judged)
        yield self._answered(session.finish(until))
        yield session.end(until)

    def _answered(self, judged: list[Judged]) -> list[Judged]:
        return judged if self._oracles is None else judged + self._oracles.settle()

    def _in_recorded_order(self, first: Recorded, rest: Iterator[Recorded]) -> Iterator[list[Judged]]:
        """Judge steps by their recorded positions, each once all events that arrived before it are read."""
        leading = [first]
        while leading[-1].event.stream.kind == TICK and (following := next(rest, None)) is not None:
            leading.append(following)  # a tick is of one order, and an event tells which there are
        used = {place.order for recorded in leading for place in recorded.places}
        ordering = replace(self.spec.ordering, by="both" if len(used) > 1 else used.pop())
        self.spec = replace(self.spec, ordering=ordering)
        session = self._session = self._open(first.begun)
        again = Again(session, self.recording.passed_over)
        waiting: list[tuple[int, Place, Step]] = []
        for recorded in itertools.chain(leading, rest):
            if not recorded.places:
                raise TraceError(f"{recorded.place}: {_OF_ANOTHER}")
            event = self._take(recorded)
            while waiting and waiting[0][1].judged < event.arrived:
                yield again.judge(*heapq.heappop(waiting))
            signals, failed = _project(session, event)
            step = Step(event, signals, failed, event.stamp or event.arrived)
            for place in recorded.places:
                again.expect(place.position)
                heapq.heappush(waiting, (place.position, place, step))
        while waiting:
            yield again.judge(*heapq.heappop(waiting))
        yield again.finish()

    def _take(self, recorded: Recorded) -> Event:
        event = recorded.event
        if event.stream.kind != TICK:
            if event.row is None or (event.monitor, event.seq) != self._last:  # rows of one event follow each other
                self.events += 1
            self._last = event.monitor, event.seq
            self.lacking.look(recorded)
            self.fields.look(event.stream, event.data)
            self.row_names.look(event.stream, event.data)
            if self.recording.clocked:
                self.units.look(recorded)
        if recorded.passed is not None:
            self.passed[event.monitor, event.seq] = (recorded.passed, recorded.why)
        if recorded.verdict is not None:
            self.comparison.expect(event, recorded.verdict)
        return event

    def _open(self, begun: int | None) -> Session:
        """A new session, which began at a time (ns), or with its first monitor where that is not known.

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
    def begun(self) -> dict[str, int]:
        """The formulas over numbers that were unknown at first, with the number of the first step that was judged."""
        return self._unjudged.begun

    @property
    def coverage(self) -> Coverage:
        """The events and signals of each stream."""
        return {key: counting.counts() for key, counting in self._counting.items()}

    def kinds(self, stream: StreamKey, signal: str) -> frozenset[ValueKind]:
        """What kinds of values a signal of a stream had."""
        return self._counting[stream].kinds(signal)

    def readers(self, name: str) -> Set[int]:
        """The properties, by their indexes, that read or guard a topic, service or action of this name."""
        return self._plan.readers.get(name, frozenset())

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
        if self.revises:
            summary |= {"revised": self._settling.revised, "retracted": self._settling.retracted}
            summary["appeared"] = self._settling.appeared
        return summary | self.comparison.summary()

    @property
    def revised(self) -> str:
        """What was put right because of late events, in words; empty where nothing was."""
        found = self._settling
        if not found.revised:
            return ""
        text = f"{counted(found.revised, 'verdict')} {'was' if found.revised == 1 else 'were'} revised"
        text += f", {counted(found.retracted, 'violation')} retracted" if found.retracted else ""
        text += f", and {counted(found.appeared, 'violation')} found" if found.appeared else ""
        return f"{text}, because of events that came late"

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
                **({} if state.pending is None else {"pending": state.pending}),
            }
            for order, judge in self._session.judges.items()
            for state in judge.properties
        }


def changeable(session: Session) -> Set[int] | None:
    """The positions of the rows of a session that can still be revised; None where it may be any."""
    kept: set[int] = set()
    for judge in session.judges.values():
        if isinstance(judge, RevisingJudge):
            if judge.is_going:
                return None
            judge.forget()
            kept.update(row.position for row in judge.keeping)
    return kept


def _counts_steps(prop: Property) -> bool:
    """Whether a verdict depends on how many steps there are, of whatever stream."""
    if prop.external or prop.numeric:
        return prop.time == "steps"
    for node in walk(prop.formula):
        bound: Bound | None = getattr(node, "bound", None)
        steps = prop.time == "steps" and bound is not None and (bound.lower > 0 or bound.upper is not None)
        if steps or isinstance(node, Pre | Next):
            return True
    return False


def _meanwhile(session: Session, until: int) -> Iterator[list[Judged]]:
    """What a session does of itself before a time (ns), each when it is due: a deadline that runs out, say."""
    last = -1
    while (due := session.next_deadline) is not None and last < due < until:
        yield session.advance(due)
        last = due


def in_order(spec: Spec, by: By | None) -> Spec:
    """A spec with another order, None for its own; only that of publication is revised."""
    if by is None:
        return spec
    ordering = replace(spec.ordering, by=by)
    if by != "publication" and ordering.late == "revise":
        ordering = replace(ordering, late="judge")
    return replace(spec, ordering=ordering)


def _project(session: Session, event: Event) -> tuple[Mapping[str, Scalar], frozenset[str]]:
    if event.stream.kind == TICK:  # which may be of one key of a derived signal
        return event.data if isinstance(event.data, Projected) else ({}, frozenset())
    return session.plan.streams[event.stream].project(event.data)
