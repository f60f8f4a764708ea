"""Explanations of verdicts in the history: the session is judged again up to the verdict, and more steps are kept."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from oracle_server.core.events import ENDED, Order
from oracle_server.core.plan import Plan
from oracle_server.core.records import ExplanationRecord, VerdictRecord
from oracle_server.core.revise.queued import Asked
from oracle_server.core.revise.saving import SavableJudge
from oracle_server.core.session import Session
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Outcome, explain
from oracle_server.core.verdicts import explained as with_explanation
from oracle_server.engines.table import ENGINES
from oracle_server.history.port import Reading
from oracle_server.history.records import SnapshotRecord, StoredStep, recorded
from oracle_server.history.views import View, records, said
from oracle_server.review.again import GONE, Again, NoExplanationError, judge_in_thread, plan_of
from oracle_server.review.unknown import why_unknown

_REMEMBERED = 20_000
"""Past steps that an explanation can refer to."""
_EFFORT = 2_000_000
"""The limit on the work of one explanation."""
_LONG = 50_000
"""Steps that are always judged again from the first one; more, from a snapshot before the verdict if there is one."""


async def explained(history: Reading, session: int, n: int, view: View = "standing") -> VerdictRecord | None:
    """Verdict record `n` of a session with its explanation, None where there is no such record.

    It is explained as it stands, or was said at first. A verdict that was final already is explained by the step that
    made it final. This takes as long as judging all steps before it, in a thread, and can be cancelled. Raises
    `NoExplanationError` or `HistoryError`.
    """
    opened = await history.session(session)
    if opened is None:
        return None
    before, index = divmod(n - 1, len(opened.properties))
    stored = await history.step(session, before + 1)
    if stored is None:
        return None
    record = next((r for r in records(stored, opened.properties, view) if r["n"] == n), None)
    if record is None and stored.revision is None:
        raise NoExplanationError(f"verdict {n} does not stand: its deadline would not have run out; ask with as=first")
    if record is None or (record["explanation"] is not None and ("revised" in record or "revises" in record)):
        return record
    if "revises" in record:
        first = record["revises"]["from"]
        raise NoExplanationError(f"verdict {n} is a revision; ask why verdict {first} stands as it does")
    ready = await history.in_thread(partial(plan_of, opened))
    prop = ready.spec.properties[index]
    if not ENGINES[prop.engine].explicable and record["explanation"] is not None:
        return record
    _demand_explicable(record, prop, stored)
    if record["outcome"] == Outcome.UNKNOWN:
        reason = await why_unknown(history, session, stored, index, ready, opened.begun)
        raise NoExplanationError(f"verdict {n} is no judgement: {reason}")
    target = await _decided(history, session, stored, index, ready)
    if ready.spec.ordering.late == "revise":
        step = stored if target == stored.position else await history.step(session, target)
        if step is None:
            raise NoExplanationError(GONE)
        again: _Explaining = _ExplainingRevised(ready, index, step, opened.begun, stands=view == "standing")
    else:
        again = _Explaining(ready, index, stored.order, target, opened.begun)
    return with_explanation(record, await _explain(history, session, again))


def _demand_explicable(record: VerdictRecord, prop: Property, stored: StoredStep) -> None:
    if not ENGINES[prop.engine].explicable:
        raise NoExplanationError(f"the engine of '{prop.id}' can't explain its verdicts")
    if stored.step.skipped and not stored.is_tick:
        raise NoExplanationError(f"verdict {record['n']} is no judgement: its event was late, or could not be stored")


async def _decided(history: Reading, session: int, stored: StoredStep, index: int, ready: Plan) -> int:
    """The position of the step that decides a verdict: the one that made it final, or the last that was judged."""
    found = await history.first_final(session, stored.order, index, stored.position)
    if (
        found is None
        and stored.is_tick
        and stored.step.event.source != ENDED
        and ready.spec.properties[index].time == "steps"
    ):  # it ignores ticks
        undoing = [key for key, stream in ready.streams.items() if stream.undoes]
        found = await history.last_counted(session, stored.order, stored.position, undoing)
    return found or stored.position


async def _explain(history: Reading, session: int, again: _Explaining) -> ExplanationRecord | None:
    first, last = await history.extent(session)
    if first > last:
        raise NoExplanationError(GONE)
    snapshot = await history.snapshot(session) if again.target > _LONG or first > 1 else None
    if snapshot is not None and not first - 1 <= snapshot.position < again.target:
        snapshot = None
    position = await history.in_thread(partial(again.begin, snapshot))
    if position < first - 1:
        raise NoExplanationError(GONE)
    async for page in history.steps(session, position, again.upto):
        await judge_in_thread(history, again, page, position)
        position = page[-1].position
        if again.is_done:
            break
    if position < again.target:
        raise NoExplanationError(GONE)
    if again.explanation is None and again.upto != again.target:
        raise NoExplanationError("judged again, it does not come out as it stands, so that it can't be explained")
    return again.explanation


class _Explaining(Again):
    """A session judged again up to a position."""

    def __init__(self, ready: Plan, index: int, order: Order, target: int, begun: int | None) -> None:
        super().__init__(ready, index, begun)
        self.target = target
        self.upto: int | None = target
        """The position of the last step that is judged again; None for the last one that there is."""
        self.explanation: ExplanationRecord | None = None
        """The explanation of the property's outcome at the target, once that was judged."""
        self._order = order

    @property
    def is_done(self) -> bool:
        """Whether later steps change nothing of the explanation."""
        return False

    def _judge(self, stored: StoredStep) -> None:
        state = self._core.judges[self._order].properties[self._index]
        self._repeat(stored)
        state.asked = stored.position == self.target
        judged = self._core.rejudge(stored.order, stored.step, stored.judged)
        if state.asked and judged is not None:
            self.explanation = explain(judged, judged.verdicts[self._index])

    def _fresh(self) -> Session:
        core = super()._fresh()
        for judge in core.judges.values():
            judge.remember(_REMEMBERED, _EFFORT)
        return core


class _ExplainingRevised(_Explaining):
    """The same of a session that revises: late events are put in their places again.

    What stands is explained with those that came after it, as far as its place could be before theirs.
    """

    def __init__(self, ready: Plan, index: int, step: StoredStep, begun: int | None, *, stands: bool) -> None:
        super().__init__(ready, index, step.order, step.position, begun)
        self.upto = None if stands else step.position
        self._asked = Asked(step.position, index, step.step.stamp if step.is_tick else None)
        self._names = tuple([p.id for p in ready.spec.properties])
        self._outcome = said(step, "standing" if stands else "first").outcomes[index]
        self._judged = False

    @property
    def is_done(self) -> bool:
        """Whether the step is not kept any more: no late event can change it."""
        return self._judged and all(row.position != self.target for row in self._revising.keeping)

    def begin(self, snapshot: SnapshotRecord | None) -> int:
        """Begin the session, and ask of the step."""
        position = super().begin(snapshot)
        self._revising.asked = self._asked
        return position

    @property
    def _revising(self) -> SavableJudge:
        assert self._core.lateness is not None  # noqa: S101 -- as the spec revises
        return self._core.lateness.judge

    def judge(self, steps: Sequence[StoredStep], position: int) -> None:
        """Judge the steps after a position again, and look how the one that was asked of stands then."""
        super().judge(steps, position)
        self._core.finish_again()
        self._revising.forget()
        self._judged = self._judged or any(stored.position == self.target for stored in steps)
        answer = self._revising.answer
        stands = answer is not None and answer.verdicts[self._index].outcome is self._outcome
        self.explanation = explain(answer, answer.verdicts[self._index]) if answer is not None and stands else None

    def _judge(self, stored: StoredStep) -> None:
        self._core.rejudge_row(recorded(stored, self._names), stored.position)
