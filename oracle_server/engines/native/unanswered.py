"""Why obligations were not answered: the event that triggered each, its values, and the steps that were looked at."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from oracle_server.core.explanation import Reason, Why
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead, obligation
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Formula
from oracle_server.core.naming import event_name, moment, step_name
from oracle_server.core.past import Past
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.explain import A_PART, Explainer
from oracle_server.engines.native.keys import texts_of
from oracle_server.engines.native.obligations import Obligations
from oracle_server.engines.native.parts import Part
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.resolved import Decided
from oracle_server.engines.native.unmet import Unmet
from oracle_server.engines.native.wording import Wording, given, named

_MOST_TOLD = 3
Reasons = Callable[[Part], list[Reason]]
"""Why a part that only looks back does not hold at the present step."""


def explain_obligations(
    formula: Formula, network: Network, owed: Obligations, time: Time, last: int, past: Past
) -> Why:
    """Why obligations were decided false with the last step, number `last`, or that none was."""
    if not owed.at_step and not _is_tick(past):
        return _explain(formula, owed, time, None, None)
    recall = Recall(formula, network, time, last if owed.at_step else last + 1, past)
    wording = Wording(time, network.timeline.now if owed.at_step else recall.time(recall.last), recall)
    explainer = Explainer(network, recall, wording)
    reasons = partial(explainer.reasons, holds=False, steps=[last]) if owed.at_step else None
    try:
        return _explain(formula, owed, time, reasons, Unmet(recall, wording, explainer, last))
    finally:
        if past.spent is not None:
            past.spent(recall.spent + A_PART * (len(network.atoms) + len(network.operators)))


def _is_tick(past: Past) -> bool:
    """Whether the present is known, and no step."""
    return past.seen is not None and bool(past.times) and not past.seen(len(past.times) - 1).event


def _explain(formula: Formula, owed: Obligations, time: Time, reasons: Reasons | None, unmet: Unmet | None) -> Why:
    """Without `reasons` time alone has decided."""
    failed = owed.failed
    if not failed:
        text = f"none of its obligations failed here; {owed.pending} of them are open"
        return Why(True, {}, 0, (Reason(named(formula, time), True, text),))
    told = _Telling(formula, owed, time, reasons, unmet)
    return Why(False, owed.values(failed[0].key), owed.failures - 1, tuple(map(told.reason, failed[:_MOST_TOLD])))


class _Telling:
    def __init__(
        self, formula: Formula, owed: Obligations, time: Time, reasons: Reasons | None, unmet: Unmet | None
    ) -> None:
        found = obligation(formula)
        assert found is not None  # noqa: S101 -- it has obligations
        self._found, self._owed, self._time, self._reasons, self._unmet = found, owed, time, reasons, unmet

    def reason(self, failed: Decided) -> Reason:
        """Why one obligation was not answered."""
        goal = given(self._found.goal, dict(self._owed.values(failed.key)))
        event = failed.event
        at = step_name(event.get("step"), event["stamp"])
        name = event_name(event["stream"], event["kind"], event["seq"], event["monitor"], event.get("row"))
        text = f"asked for at {at}, {name}; {self._outcome(failed)}"
        return Reason(named(goal, self._time), False, text, parts=self._parts(failed), told=True)

    def _outcome(self, failed: Decided) -> str:  # noqa: PLR0911 -- a case an operator
        goal = self._found.goal
        if self._owed.ended:
            return "it had not come when the session ended"
        match goal:
            case tree.Eventually(_, bound):
                return f"at none of {self._looked_at(failed, bound)}"
            case tree.Always(operand) if not looks_ahead(operand) and self._reasons:
                return "it fails at this step"
            case tree.Next(operand) if not looks_ahead(operand):
                return "it fails at this step, the one after"
            case tree.Until(left, right, bound) if not looks_ahead(left) and not looks_ahead(right):
                if self._is_over(failed, bound):
                    return f"at none of {self._looked_at(failed, bound)}"
                return "its left side fails at this step"
            case _:
                return "it can't hold any more"

    def _is_over(self, failed: Decided, bound: tree.Bound) -> bool:
        """Whether the bound had passed; before that a left side alone that fails decides."""
        return self._reasons is None or self._owed.is_over(failed.start, bound.upper)

    def _looked_at(self, failed: Decided, bound: tree.Bound) -> str:
        """The steps within a bound that has passed."""
        time, number = failed.start
        if bound.upper is None:
            return "the steps since"
        if self._time == "steps":
            first, last = number + bound.lower, number + bound.upper
            return f"steps {first}–{last}" if last > first else f"step {first}"  # noqa: RUF001 -- a range
        until = moment(time + bound.upper, failed.event["stamp"])
        if bound.lower:
            return f"the steps from {moment(time + bound.lower, failed.event['stamp'])} until {until}"
        if isinstance(self._found.goal, tree.Eventually) and looks_ahead(self._found.goal.operand):
            return f"the steps until {until}"  # decided later than that, by what was awaited of them
        count = self._owed.number - number + (self._reasons is None)  # a step that is later is not among them
        return f"{count} step{'s' if count != 1 else ''} until {until}"

    def _parts(self, failed: Decided) -> tuple[Reason, ...]:
        """What was met and what was not; or why the operand does not hold at the present step, where that decides."""
        scope = {name: number for number, name in enumerate(self._found.variables, 1)}
        values = dict(enumerate(texts_of(failed.key), 1)) if scope else {}
        part = Part(self._found.goal, self._found.goal_path, scope, values)
        if self._unmet is not None and not self._owed.ended and self._unmet.knows(failed.start, failed.event):
            unmet = self._unmet.within(part, failed.start[1])
            if isinstance(self._found.goal, tree.And | tree.Or) or _looks_on(self._found.goal):
                unmet = self._unmet.failed(part, failed.start[1])
            if unmet:
                return unmet
        if self._reasons is None:
            return ()
        match self._found.goal:
            case tree.Always(operand) | tree.Next(operand) if not looks_ahead(operand):
                return tuple(self._reasons(part.child(operand)))
            case tree.Until(left, right, bound) if not looks_ahead(left) and not looks_ahead(right):
                return () if self._is_over(failed, bound) else tuple(self._reasons(part.child(left)))
        return ()


def _looks_on(goal: Formula) -> bool:
    """Whether what is awaited of the step after waits itself."""
    return isinstance(goal, tree.Next) and looks_ahead(goal.operand)
