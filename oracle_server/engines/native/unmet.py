"""What was met of an obligation that was not answered, and what was not: `eventually (φ and eventually ψ)`."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from oracle_server.core.explanation import Reason
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import Bound
from oracle_server.core.records import EventRecord
from oracle_server.engines.native.explain import Explainer
from oracle_server.engines.native.parts import Part
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.waiting import Moment
from oracle_server.engines.native.wording import Wording, duration

_MOST = 20
"""Most parts that are joined, and looked at."""


class Unmet:
    """Looks at the remembered steps for the parts of what was awaited; tells nothing where these are not all known."""

    def __init__(self, recall: Recall, wording: Wording, explainer: Explainer, upto: int) -> None:
        """`upto` is the number of the last step."""
        self._recall, self._wording, self._explainer, self._upto = recall, wording, explainer, upto

    def knows(self, start: Moment, event: EventRecord) -> bool:
        """Whether the step that asked, of this event, is remembered."""
        seen = self._recall.seen(start[1])
        return seen is not None and seen.number == event.get("step") and seen.stamp == event["stamp"]

    def within(self, part: Part, step: int) -> tuple[Reason, ...]:
        """What was met, and what was not, of an `eventually` that is false about a step."""
        found = _sides(part.child(part.formula.operand)) if isinstance(part.formula, tree.Eventually) else None
        if found is None or not isinstance(part.formula, tree.Eventually):
            return ()
        now, later = found
        window = self._window(step, part.formula.bound)
        held = self._held(now, window)
        if not window or held is None:
            return ()
        if not held:
            return (self._explainer.stood(now, window, holds=False),)
        return self._explainer.stood(now, held, holds=True), self._awaited(later, held[-1])

    def failed(self, part: Part, step: int) -> tuple[Reason, ...]:
        """Which parts are known to be false about a step, of several that are joined by `and` or `or`."""
        alone = islice(self._alone(part, step), _MOST)
        return tuple(reason for each, at in alone for reason in self._false(each, at))

    def _alone(self, part: Part, step: int) -> Iterator[tuple[Part, int]]:
        """The parts that are joined, each with the step about which it is asked."""
        match part.formula:
            case tree.And(left, right) | tree.Or(left, right):
                yield from self._alone(part.child(left), step)
                yield from self._alone(part.child(right, 1), step)
            case tree.Next(operand):
                if step < self._upto:
                    yield from self._alone(part.child(operand), step + 1)
            case _:
                yield part, step

    def _false(self, part: Part, step: int) -> tuple[Reason, ...]:
        """That a part is false about a step, where that is known."""
        match part.formula:
            case tree.Eventually(operand, bound) if not looks_ahead(operand):
                none = self._is_over(step, bound) and self._held(part.child(operand), self._window(step, bound)) == []
                return (self._awaited(part, step),) if none else ()
            case tree.Always(operand, bound) if not looks_ahead(operand):
                return self._broken(part.child(operand), self._window(step, bound))
            case formula if not looks_ahead(formula):
                return self._broken(part, [step])
        return ()

    def _broken(self, part: Part, steps: list[int]) -> tuple[Reason, ...]:
        """The first of some steps at which a part did not hold."""
        held = self._held(part, steps)
        missed = next((step for step in steps if held is not None and step not in held), None)
        return () if missed is None else (self._explainer.stood(part, [missed], holds=False),)

    def _is_over(self, step: int, bound: Bound) -> bool:
        """Whether no step that comes is within a bound of this one."""
        if bound.upper is None:
            return False
        now, end = self._recall.time(self._recall.last), self._recall.time(step) + bound.upper
        return now > end if self._wording.is_timed else now >= end

    def _awaited(self, part: Part, step: int) -> Reason:
        """That what was awaited from a step on, and is false about it, has not come."""
        text = f"asked for {self._wording.at([self._recall.time(step)], [step])}; "
        if not isinstance(part.formula, tree.Eventually):
            return Reason(self._wording.formula(part), False, f"{text}it can't hold any more")
        window, bound = self._window(step, part.formula.bound), part.formula.bound
        if not self._wording.is_timed:
            where = self._wording.during(window[0], window[-1]) if window else "in any step"
            text += f"none {where}"
        else:
            within = "" if bound.upper is None else f" within {duration(bound.upper)}"
            text += f"at none of {len(window)} step{'s' if len(window) != 1 else ''}{within}"
        parts = self.within(part, step)
        return Reason(self._wording.formula(part), False, text, parts=parts, told=bool(parts))

    def _window(self, step: int, bound: Bound) -> list[int]:
        """The steps from this one on within a bound of it."""
        since = self._recall.time(step)
        last = self._recall.time(self._upto) if bound.upper is None else since + bound.upper
        steps = range(step, self._upto + 1)
        return [j for j in steps if since + bound.lower <= self._recall.time(j) <= last]

    def _held(self, part: Part, steps: list[int]) -> list[int] | None:
        """At which of some steps a part held; None where that is not known of all, or something failed at one."""
        found = []
        for step in steps:
            seen, value = self._recall.seen(step), self._recall.at(part, step)
            if seen is None or seen.failed or value is None:
                return None
            if value:
                found.append(step)
        return found


def _sides(part: Part) -> tuple[Part, Part] | None:
    """What must hold at a step itself, and what is awaited from there on; None where there are not these two."""
    if not isinstance(part.formula, tree.And):
        return None
    left, right = part.child(part.formula.left), part.child(part.formula.right, 1)
    if looks_ahead(left.formula) is looks_ahead(right.formula):
        return None
    return (right, left) if looks_ahead(left.formula) else (left, right)
