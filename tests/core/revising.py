"""Sessions that revise, on random events that come late, and the same events judged in the order of publication.

What stands is read of what the session said, as a history would: row by row, with the revisions.
"""

from __future__ import annotations

import itertools
import json
import random
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import msgspec

from oracle_server.core.atoms import canonical
from oracle_server.core.events import Event, Step, StreamKey
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.judging.deciding import is_denied
from oracle_server.core.judging.judge import Judge
from oracle_server.core.ordering.simulated import ClockReading
from oracle_server.core.plan import StreamPlan, plan
from oracle_server.core.revise.kept import Kept
from oracle_server.core.revisions import Revision, Standing
from oracle_server.core.session import Session
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from oracle_server.core.verdicts import FINAL, Judged, Outcome, explain
from oracle_server.engines.native import NativeEngine
from tests import generate
from tests.strategies import SECOND, START

COUNTED = ("late", "skewed", "skipped", "lost", "denied", "revised", "retracted")
A, B, H, U = (StreamKey(name, "topic") for name in ("/a", "/b", "/h", "/u"))


class Case(NamedTuple):
    """A spec, and its monitors' events in the order in which they come."""

    spec: Spec
    events: list[Event]


def case(rng: random.Random, time: Time, *, horizon: int = 60 * SECOND) -> Case:
    """A random case: some streams without order, some that hold, some events that ask, and are taken back."""
    asks = rng.random() < 0.5
    properties = []
    for name in "pq":
        formula = generate.formula(rng, time, rng.randint(2, 4))
        guards = frozenset({"/a"}) if asks and rng.random() < 0.7 else frozenset()
        blame: Literal["any", "caused"] = "caused" if guards and rng.random() < 0.3 else "any"
        properties.append(
            Property(
                name, formula, render(formula, time), time=time, guards=guards, latch=rng.random() < 0.2, blame=blame
            )
        )
    undo: Literal["undo", "keep"] = "undo" if asks and rng.random() < 0.6 else "keep"
    streams = (
        StreamSpec("/a", action="filter" if asks else "log", on_deny=undo),
        StreamSpec("/b"),
        StreamSpec("/h", hold=frozenset({"c"})),
        StreamSpec("/u", ordered=False),
    )
    ordering = Ordering(max_delay=2 * SECOND, late="revise", horizon=horizon)
    return Case(Spec("s", streams, tuple(properties), ordering), list(events(rng, asks=asks)))


def events(rng: random.Random, *, asks: bool) -> Iterator[Event]:
    """Events of two monitors, some of which come up to 8 s after they were published."""
    steps = generate.trace(rng, rng.randint(3, 14))
    keys = [rng.choice([A, A, B, B, H, *([U] if rng.random() < 0.4 else [])]) for _ in steps]
    lateness = (0, 0, 1, SECOND, 3 * SECOND, 5 * SECOND, 8 * SECOND)
    coming = sorted(
        (at + (0 if key is U else rng.choice(lateness)), i, key, at, signals)
        for i, (key, (at, signals)) in enumerate(zip(keys, steps, strict=True))
    )
    seqs = {monitor: itertools.count(1) for monitor in "mn"}
    for arrived, _, key, at, signals in coming:
        monitor = rng.choice("mn")
        ask = asks and key is A
        yield Event(key, monitor, next(seqs[monitor]), at, arrived, dict(signals), source=str(arrived), ask=ask)


@dataclass
class Book:
    """What a session said, row by row, and what stands of it."""

    width: int
    first: dict[int, Judged] = field(default_factory=dict)
    standing: dict[int, Standing] = field(default_factory=dict)
    revisions: list[Revision] = field(default_factory=list)
    rows: dict[int, Judged] = field(default_factory=dict)
    judged: set[tuple[str, int, int | None]] = field(default_factory=set)
    ticks: int = 0

    def take(self, judged: Iterable[Judged]) -> None:
        for row in judged:
            n = row.first if isinstance(row, Revision) else row.verdicts[0].n
            assert (n - 1) // self.width == len(self.rows), "rows are numbered on"
            self.rows[len(self.rows) + 1] = row
            if isinstance(row, Revision):
                self.revise(row)
            else:
                ns = [v.n for v in row.verdicts]
                position = len(self.rows)
                assert ns == list(range((position - 1) * self.width + 1, position * self.width + 1))
                self.first[position] = row
                event = row.step.event
                if event.monitor:
                    assert (event.monitor, event.seq, event.row) not in self.judged, "each is judged once"
                    self.judged.add((event.monitor, event.seq, event.row))
                if not row.step.event.monitor:
                    self.ticks += 1
                    assert row.step.event.seq == self.ticks, "deadlines are numbered on"

    def revise(self, row: Revision) -> None:
        assert row.causes
        self.revisions.append(row)
        self.standing |= row.standing
        for i, change in enumerate(row.changes):
            if change is None:
                continue
            assert change.n == row.first + i
            for n in range(change.first, change.last + 1, self.width):
                position = (n - 1) // self.width + 1
                if position in self.first:  # else it is a revision
                    stands = self.standing[position]
                    assert stands.outcomes[i] is change.outcome
                    assert stands.degraded[i] == change.degraded
            assert change.violation is (change.explanation is not None)

    def counts(self) -> Counter[str]:
        """What a session counts of these rows that was never restarted."""
        found = Counter[str]()
        for row in self.first.values():
            step, whole = row.step, not row.step.event.row
            found["late"] += step.late and whole
            found["skewed"] += step.skewed and whole
            found["skipped"] += step.skipped and whole
            found["lost"] += step.event.lost
            found["denied"] += is_denied(row.decision)
            for what, count in (("late", step.late and whole), ("lost", step.event.lost)):
                found[f"{what} of {step.event.stream} of {step.event.monitor}"] += count
        changes = [change for row in self.revisions for change in row.changes if change is not None]
        found["revised"], found["retracted"] = len(changes), sum(change.retracted for change in changes)
        return found

    def stands(self, position: int) -> Standing:
        row = self.first[position]
        found = ((i, explain(row, v)) for i, v in enumerate(row.verdicts))
        whys = {i: why for i, why in found if why is not None}
        said = Standing(tuple([v.outcome for v in row.verdicts]), tuple([v.degraded for v in row.verdicts]), whys)
        return self.standing.get(position, said)


class Line(NamedTuple):
    """A row as it stands, compared with the one of the reference."""

    monitor: str
    seq: int
    time: int
    outcomes: tuple[Outcome | None, ...]
    violations: frozenset[int]
    keys: frozenset[tuple[str, str]] = frozenset()
    """Of a deadline the keys that it is for, or that are held: signals with their values."""


@dataclass
class Run:
    """A session that judges a case as it comes, and the order in which its rows were first judged."""

    case: Case
    divided: bool = False
    restarts: float = 0.0
    """How likely it is to be restarted before an event."""
    stops: random.Random | None = None
    """Decides where it stops before all is judged that is due, None for never."""
    suspends: random.Random | None = None
    """Decides when what is judged can't be kept, and is skipped; None for never."""
    saved: tuple[int, str] | None = None
    book: Book = field(init=False)
    levels: dict[tuple[str, int], int] = field(default_factory=dict)
    keys: dict[tuple[str, int], int] = field(default_factory=dict)
    presents: dict[tuple[str, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        spec = self.case.spec
        self.book = Book(len(spec.properties))
        self.session = self.fresh()
        self.attach(START)

    def fresh(self) -> Session:
        spec = self.case.spec
        session = Session(plan(spec), [[NativeEngine(p.formula, p.time) for p in spec.properties]], begun=START)
        if self.divided:
            session.divide(lambda: True)
        return session

    def attach(self, now: int) -> None:
        for monitor in "mn":
            self.take(self.session.attach(monitor, self.case.spec.by_key, now))

    def save(self) -> None:
        """Take a snapshot, as a server does now and then."""
        if self.session.can_be_saved:
            data = self.session.snapshot()
            assert data is not None
            assert "revising" in data
            self.saved = data["revising"]["position"], json.dumps(data)

    def restart(self, now: int, sent: list[Event]) -> None:
        """Kill the session, restore it from what was said, and send again what it had not judged."""
        self.session = self.fresh()
        position = 0
        if self.saved is not None:
            position, data = self.saved
            self.session.restore(json.loads(data), position * self.book.width + 1)
        assert self.session.lateness is not None
        self.session.lateness.judge.together = 1 + len(self.book.rows) % 5
        for at in range(position + 1, len(self.book.rows) + 1):
            self.session.rejudge_row(self.book.rows[at], at)
        self.session.finish_again()
        self.check_counts()
        self.attach(now)
        known = {(row.step.event.monitor, row.step.event.seq) for row in self.book.first.values()}
        for event in sent:
            if (event.monitor, event.seq) not in known:
                self.ingest(msgspec.structs.replace(event, arrived=now))

    def judge(self, rng: random.Random) -> None:
        for i, event in enumerate(self.case.events):
            self.take(self.advance(event.arrived))
            self.settle(rng)
            if rng.random() < self.restarts:
                self.save()
            if rng.random() < self.restarts:
                self.restart(event.arrived, self.case.events[:i])
            self.session.suspended = self.suspends is not None and self.suspends.random() < 0.2
            self.ingest(event)
            self.session.suspended = False
            if rng.random() < 0.3:
                clock = ClockReading(event.stream, event.arrived - SECOND)
                self.take(self.session.clock(event.monitor, [clock], event.arrived))
        self.take(self.session.finish(self.case.events[-1].arrived + 10 * SECOND))
        self.check_counts()

    def check_counts(self) -> None:
        """A session counts what it said, no matter how often it was restarted."""
        counters = self.session.judges["publication"].told.counters
        found = Counter({name: getattr(counters, name) for name in COUNTED})
        for (monitor, stream), of in self.session.counts.items():
            found |= {f"late of {stream} of {monitor}": of.late, f"lost of {stream} of {monitor}": of.lost}
        assert +found == +self.book.counts()

    def ingest(self, event: Event) -> None:
        self.take(self.session.ingest(event))

    def advance(self, now: int) -> Iterator[Judged]:
        """Let time pass as the server's timer does."""
        for _ in range(100_000):
            due = self.session.next_deadline
            if due is None or due > now:
                return
            yield from self.session.advance(max(due, self.session.now))
            if self.stops is not None and self.stops.random() < 0.1:
                return
        raise AssertionError("the session never comes to rest")

    def settle(self, rng: random.Random) -> None:
        """Let a pass that is divided go on for a while, or to its end."""
        while self.session.lateness and self.session.lateness.judge.is_going and rng.random() < 0.7:
            self.take(self.session.advance(self.session.now))

    def take(self, judged: Iterable[Judged]) -> None:
        """Note what was said, and where a step without order has its place."""
        judged = list(judged)
        self.book.take(judged)
        assert self.session.lateness is not None
        unordered = {stream.key for stream in self.case.spec.streams if not stream.ordered}
        there = any(j.step.event.stream in unordered for j in judged)
        judge = self.session.lateness.judge
        again = (row for row in judge.ahead if isinstance(row, Kept))  # a pass may have begun behind them
        for row in [*judge.keeping, *again] if there else ():
            event = row.step.event
            if event.stream in unordered and (event.monitor, event.seq) not in self.keys:
                identity = event.monitor, event.seq
                self.levels[identity], self.keys[identity] = row.level, row.key
                self.presents[identity] = row.present

    def stands(self) -> list[Line]:
        """What stands, in the order of publication."""
        lines = []
        for position, row in self.book.first.items():
            stands = self.book.stands(position)
            if stands.outcomes[0] is not None:
                event = row.step.event
                lines.append(
                    (
                        position,
                        Line(
                            event.monitor,
                            event.seq,
                            row.step.stamp,
                            stands.outcomes,
                            frozenset(stands.explanations),
                            keys_of(self.case.spec, row),
                        ),
                    )
                )
        return [line for _, line in lines]


def keys_of(spec: Spec, row: Judged) -> frozenset[tuple[str, str]]:
    """What tells a deadline from others of its time."""
    signals = {} if row.step.event.monitor else row.step.signals
    return frozenset((by, canonical(signals[by])) for d in spec.derive for by in d.by if by in signals)


class Sorted(Judge):
    """A judge to which a step without order comes at the time at which it came first, and others in their places."""

    at_least = 0

    def _surely_past(self, step: Step) -> int:
        return 0 if self.plan.streams[step.event.stream].spec.ordered else super()._surely_past(step)

    def _move_on(self, step: Step, stream: StreamPlan) -> None:
        super()._move_on(step, stream)
        self.present = max(self.present, self.at_least)


def reference(run: Run) -> list[Line]:
    """The same events in the order of publication, decided as they were, judged by a judge that can't go back."""
    lines = []
    for judged, _ in in_order(run):
        event, whys = judged.step.event, frozenset(i for i, v in enumerate(judged.verdicts) if v.explanation)
        outcomes = tuple([v.outcome for v in judged.verdicts])
        keys = keys_of(run.case.spec, judged)
        lines.append(Line(event.monitor, event.seq, judged.step.stamp, outcomes, whys, keys))
    return lines


def in_order(run: Run) -> list[tuple[Judged, int]]:
    """The rows of that judge, and the present (ns) at each."""
    spec = run.case.spec
    judge = Sorted(
        plan(spec), [NativeEngine(p.formula, p.time) for p in spec.properties], "publication", itertools.count(1)
    )
    judge.begin(START)
    rows = [row for row in run.book.first.values() if row.step.event.monitor]
    order = sorted(
        enumerate(rows),
        key=lambda it: (run.keys.get((it[1].step.event.monitor, it[1].step.event.seq), 2 * it[1].step.time), it[0]),
    )
    rows_again: list[tuple[Judged, int]] = []

    def add(judged: Judged, present: int) -> None:
        rows_again.append((judged, present))

    def until(time: int) -> None:
        while (deadline := judge.next_deadline) is not None and deadline <= time:
            tick = judge.tick(deadline, 0)
            if tick is not None:
                add(tick, deadline)

    timed = any(p.time == "seconds" for p in spec.properties)
    assert run.session.lateness is not None
    for _, row in order:
        identity = (row.step.event.monitor, row.step.event.seq)
        if timed:
            until(run.levels.get(identity, row.step.time - 1))
        judge.at_least = run.presents.get(identity, 0)
        denied = row.decision is not None and row.decision.choice == "deny"
        if denied and judge.plan.streams[row.step.event.stream].undoes:
            before = judge._attempt()
            attempt = judge._judge(row.step, 0, revisable=True)
            present = judge.present
            add(judge._take_back(attempt, before), present)
        else:
            attempt = judge._judge(row.step, 0)
            add(attempt, judge.present)
    if timed:
        until(run.session.lateness.judge._level)
    return rows_again


def compared(lines: Iterable[Line]) -> list[Line]:
    """Lines without what differs by intent: ticks' numbers, and when a final outcome is said to be final."""
    plain = [
        line._replace(seq=line.seq if line.monitor else 0, outcomes=tuple([o and o.current for o in line.outcomes]))
        for line in lines
    ]
    return sorted(plain, key=lambda line: (*line[:-2], sorted(line.violations), sorted(line.keys)))


__all__ = ["FINAL", "Book", "Case", "Run", "case", "compared", "in_order", "reference"]
