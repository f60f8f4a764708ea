"""Sessions judged again in which the parts of a formula are looked at, at the steps around one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from oracle_server.core.atoms import Match
from oracle_server.core.engine import Engine
from oracle_server.core.formula.outline import Row
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plan import Plan, View
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import NEGATIVE, Outcome
from oracle_server.engines.native.watched import WatchedEngine
from oracle_server.history.records import SessionRecord, StoredStep
from oracle_server.review.again import Again, NoExplanationError

Truth = Literal["holds", "fails", "unknown", "not_told"]
_TRUTHS: Mapping[bool | None, Truth] = {True: "holds", False: "fails", None: "not_told"}
ALWAYS, NEVER = range(2**63), range(0)


@dataclass(frozen=True, slots=True)
class Looked:
    """What is looked at: the parts of the property of an index, at the steps around a target."""

    ready: Plan
    index: int
    opened: SessionRecord
    target: StoredStep
    rows: Sequence[Row]


@dataclass(frozen=True, slots=True)
class Seen:
    """A step, about when it stands (ns), what was told of the property, the truth of each row, and the signals."""

    stored: StoredStep
    time: int
    outcome: Outcome
    truths: Sequence[Truth]
    signals: Mapping[str, Scalar]


@dataclass(frozen=True, slots=True)
class Found:
    """The steps in their order, the index of the target's, and whether others are left out before and behind them."""

    seen: Sequence[Seen]
    at: int
    earlier: bool
    later: bool

    def within(self, span: int) -> Found:
        """Those within a span (ns) of the target. Raises `NoExplanationError` where there are none."""
        if not self.seen:
            raise NoExplanationError("they are other properties' deadlines, at which this one was not judged")
        center, last = self.seen[self.at].time, len(self.seen) - 1
        near = [i for i, seen in enumerate(self.seen) if abs(seen.time - center) <= span]
        earlier, later = self.earlier and near[0] == 0, self.later and near[-1] == last
        return Found([self.seen[i] for i in near], near.index(self.at), earlier, later)


class Watching(Again):
    """A session judged again, in which the parts of a formula are looked at."""

    def __init__(self, looked: Looked) -> None:
        self._saw: list[Mapping[str, Scalar]] = []
        super().__init__(_seen_through(looked.ready, looked.index, self._saw), looked.index, looked.opened.begun)
        self.opened, self.target, self._rows = looked.opened, looked.target, looked.rows

    def _chosen(self, prop: Property) -> Engine:
        return WatchedEngine(prop.formula, prop.time, self._rows, guards=bool(prop.guards))

    def _signals(self, outcome: Outcome | None) -> Mapping[str, Scalar]:
        """What the formula saw of the last step, where it was judged."""
        return self._saw[-1] if self._saw and outcome is not None else {}


class WatchingSpan(Watching):
    """They are looked at in a span of positions, of those that are kept."""

    def __init__(self, looked: Looked, kept: range, span: range) -> None:
        super().__init__(looked)
        self.kept, self.span = kept, span
        self._found: list[Seen] = []
        self._latest = 0

    def _judge(self, stored: StoredStep) -> None:
        if stored.position not in self.span or stored.order != self.target.order:
            super()._judge(stored)
            return
        state = self._core.judges[stored.order].properties[self._index]
        engine, before = state.engine, state.outcome
        if not isinstance(engine, WatchedEngine):  # it failed
            super()._judge(stored)
            self._add(stored, None, [])
            return
        engine.watching, engine.outcome = ALWAYS, None
        super()._judge(stored)
        outcome, engine.watching = engine.outcome, NEVER
        told = stored.outcomes[self._index]
        if outcome is None and stored.is_tick and told is before and self._index not in stored.explanations:
            return  # another property's deadline is no step of this one
        self._add(stored, outcome, engine.truths)

    def take(self, steps: Sequence[StoredStep]) -> None:
        """Take steps as they were recorded: nothing is judged again."""
        for stored in steps:
            if stored.order == self.target.order:
                self._add(stored, None, [])

    def _add(self, stored: StoredStep, outcome: Outcome | None, truths: Sequence[bool | None]) -> None:
        """Add a step, which stands at the latest stamp of one so far, so that none between two of them is left out.

        Deadlines, which may be judged long before steps of their time, are at their own.
        """
        told, time = stored.outcomes[self._index], stored.step.stamp
        if not stored.is_tick:
            time = self._latest = max(self._latest, time)
        found = told_truths(told, outcome, truths, self._rows)
        self._found.append(Seen(stored, time, told, found, self._signals(outcome)))

    @property
    def found(self) -> Found:
        """What was found."""
        before = [i for i, seen in enumerate(self._found) if seen.stored.position <= self.target.position]
        earlier, later = self.span.start > self.kept.start, self.span.stop < self.kept.stop
        return Found(self._found, before[-1] if before else 0, earlier, later)


def told_truths(
    told: Outcome, outcome: Outcome | None, truths: Sequence[bool | None], rows: Sequence[Row]
) -> Sequence[Truth]:
    """What each row came to, where `told` was recorded: nothing that contradicts it."""
    whole: Truth = "unknown" if told is Outcome.UNKNOWN else "fails" if told in NEGATIVE else "holds"
    if whole == "unknown":  # which of them what is missing decides is not known
        unknown: list[Truth] = ["unknown" if row.is_told else "not_told" for row in rows[1:]]
        return [whole, *unknown]
    again = None if outcome is None or outcome is Outcome.UNKNOWN else outcome in NEGATIVE
    if again is not (whole == "fails") or truths[0] is again:
        truths = [None] * len(rows)
    return [whole, *[_TRUTHS[truth] for truth in truths[1:]]]


def _seen_through(ready: Plan, index: int, saw: list[Mapping[str, Scalar]]) -> Plan:
    """The plan, with a property's views putting into `saw` what they were asked of last."""

    def through(views: tuple[View, ...]) -> tuple[View, ...]:
        view = views[index]
        seeing = _SeeingView(view.size, view.tests, view.reads, view.observed, saw)
        return (*views[:index], seeing, *views[index + 1 :])

    streams = {key: replace(stream, views=through(stream.views)) for key, stream in ready.streams.items()}
    return replace(ready, streams=streams, silent=through(ready.silent))


@dataclass(frozen=True, slots=True)
class _SeeingView(View):
    saw: list[Mapping[str, Scalar]] = field(default_factory=list)

    def matches(self, signals: Mapping[str, Scalar]) -> list[Match]:
        """The match of each atom; the signals are put down."""
        self.saw[:] = [signals]
        return View.matches(self, signals)
