"""The parts of a formula looked at in a session that revises: as it stands, in the order in which it does."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.revise.kept import Kept, key_of
from oracle_server.core.revise.saving import SavableJudge
from oracle_server.core.verdicts import Outcome
from oracle_server.core.weakly import weakly
from oracle_server.engines.native.watched import WatchedEngine
from oracle_server.history.records import SnapshotRecord, StoredStep, recorded
from oracle_server.history.views import said
from oracle_server.review.again import NoExplanationError
from oracle_server.review.watching import Found, Looked, Seen, Watching, told_truths

_ELSEWHERE = "judged again, it does not come out as it stands, so that its parts can't be told"


class _Noted(NamedTuple):
    """A row that was judged, or was skipped, and where it stands, as by `key_of`.

    `outcome` is what the engine said of it, None where it was not asked; `idle`: nothing changed with it, either.
    """

    row: Kept | StoredStep
    key: int
    outcome: Outcome | None = None
    truths: Sequence[bool | None] = ()
    signals: Mapping[str, Scalar] = {}
    idle: bool = False

    @property
    def time(self) -> int:
        """About when it stands (ns)."""
        return self.key // 2


class WatchingRevised(Watching):
    """A session that revises, judged again until no late event can come before the end of a span of `times` (ns).

    What comes late has all behind it judged again: what was noted of a row last is how it stands.
    """

    def __init__(self, looked: Looked, times: range, most: int) -> None:
        """Look at the steps that stand in these times, and so many of them on each side of the target at the most."""
        super().__init__(looked)
        self._times, self._most = times, most
        self._names = looked.opened.properties
        self._noted: list[_Noted] = []
        self._stored: dict[int, StoredStep] = {}
        """By position, those that were noted, and deadlines that may be."""
        self._earlier = self._later = False

    @property
    def _revising(self) -> SavableJudge:
        assert self._core.lateness is not None  # noqa: S101 -- as the spec revises
        return self._core.lateness.judge

    def begin(self, snapshot: SnapshotRecord | None) -> int:
        """Begin the session, and look at the parts at the steps of the times."""
        position = super().begin(snapshot)
        self._revising.noting = weakly(self._note)
        engine = self._revising.properties[self._index].engine
        if isinstance(engine, WatchedEngine):
            engine.watching = self._times
        return position

    def demand(self, snapshot: SnapshotRecord | None, *, whole: bool) -> SnapshotRecord | None:
        """The snapshot, where none of the steps that are wanted is in it, or where there is no other way to judge them.

        `whole`: all steps of the session are kept.
        """
        data = snapshot.data if snapshot is not None else None
        floor = data.get("revising", {}).get("floor", 0) if isinstance(data, dict) else 0
        if key_of(self._times.start) > floor:
            return snapshot
        if whole:
            return None
        self._times, self._earlier = range(floor // 2 + 1, max(floor // 2 + 1, self._times.stop)), True
        return snapshot

    @property
    def is_done(self) -> bool:
        """Whether later steps change nothing of what is told."""
        is_judged = any(each.row.position == self.target.position for each in self._noted)
        until = self._noted[-1].time if self._later else self._times.stop
        return is_judged and self._revising.keeping.floor > key_of(until, tick=True)

    def judge(self, steps: Sequence[StoredStep], position: int) -> None:
        """Judge the steps after a position again, and keep of them what is told."""
        super().judge(steps, position)
        self._core.finish_again()
        self._revising.forget()
        self._keep()

    def _judge(self, stored: StoredStep) -> None:
        if stored.revision is None:
            self._stored[stored.position] = stored
        if stored.step.skipped:
            self._core.finish_again()
            if (present := self._revising.present) in self._times:
                self._noted.append(_Noted(stored, key_of(present)))
        self._core.rejudge_row(recorded(stored, self._names), stored.position)

    def _note(self, row: Kept) -> None:
        """Note a row that was judged, and what its parts came to if the engine was asked."""
        judge = self._revising
        if row.key // 2 not in self._times:
            return
        engine, rows = judge.properties[self._index].engine, judge.keeping.rows
        outcome, truths = None, list[bool | None]()
        if isinstance(engine, WatchedEngine) and engine.at == (row.step.stamp if row.is_tick else row.present):
            outcome, truths, engine.outcome = engine.outcome, engine.truths, None
        before = (rows[-2] if len(rows) > 1 else judge.keeping.base).properties[self._index].outcome
        idle = row.is_tick and outcome is None and row.judged.verdicts[self._index].outcome is before
        self._noted.append(_Noted(row, row.key, outcome, truths, self._signals(outcome), idle))

    def _keep(self) -> None:
        """Keep of each row what was noted last, and no more rows than are told.

        Deadlines have no position until their own rows come.
        """
        last: dict[int, _Noted] = {}
        for each in self._noted:
            last.pop(each.row.position, None)
            last[each.row.position] = each
        noted = sorted(last.values(), key=lambda each: each.key)  # of one key, those that were judged last behind
        places = [i for i, each in enumerate(noted) if each.row.position == self.target.position]
        at = places[0] if places else sum(each.time <= self._center for each in noted)
        begin, end = max(0, at - self._most), at + self._most + 1 if places else len(noted)
        self._earlier, self._later = self._earlier or begin > 0, self._later or end < len(noted)
        self._noted = noted[begin:end]
        self._stored = {n: stored for n, stored in self._stored.items() if n in last or self._may_come(stored)}

    def _may_come(self, stored: StoredStep) -> bool:
        return stored.is_tick and stored.step.stamp in self._times

    @property
    def _center(self) -> int:
        return (self._times.start + self._times.stop) // 2

    @property
    def found(self) -> Found:
        """The rows that stand, in their order. Raises `NoExplanationError` where the target is none of them."""
        seen, at = list[Seen](), -1
        for each in self._noted:
            stored = self._stored.get(each.row.position)
            stands = None if stored is None else said(stored, "standing")
            told = None if stands is None else stands.outcomes[self._index]
            if stored is None or stands is None or told is None:
                continue
            if not (each.idle and self._index not in stands.explanations):
                truths = told_truths(told, each.outcome, each.truths, self._rows)
                seen.append(Seen(stored, each.time, told, truths, each.signals))
            if stored.position == self.target.position:
                at = max(0, len(seen) - 1)
        if at < 0:
            raise NoExplanationError(_ELSEWHERE)
        return Found(seen, at, self._earlier, self._later)
