"""The words of explanations: formulas with values, steps and windows."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render, render_value
from oracle_server.core.formula.tree import Atom, Bound, Call, Constraint, Formula, Limit, Ref, Scalar
from oracle_server.core.naming import step_name
from oracle_server.engines.native.keys import Text
from oracle_server.engines.native.parts import Part, Values
from oracle_server.engines.native.recall import Recall

_MOST_RANGES = 4
_ATTEMPT = "at this attempt"


class Wording:
    """Tells steps and windows as seen from the present one; times are step numbers or, with `time: seconds`, ns."""

    def __init__(self, time: Time, now: int, recall: Recall) -> None:
        self._time: Time = time
        self._now, self._recall = now, recall
        self.is_timed = time == "seconds"
        present = recall.seen(recall.last)
        self._stamp = None if present is None else present.stamp
        self.is_tick = present is not None and not present.event
        """Whether the present step is a deadline."""
        self._attempt = present is not None and present.number is None and not self.is_tick
        """Whether the present step is about to be taken back, so that its number will be another's."""

    def formula(self, part: Part) -> str:
        """A part, with values in place of its variables; where it has a name, behind that."""
        return named(self._valued(part), self._time)

    def name(self, part: Part) -> str:
        """The same within a sentence, where a name is enough."""
        formula = self._valued(part)
        return render(formula, self._time, named=True) if formula.written is None else str(formula.written)

    def _valued(self, part: Part) -> Formula:
        texts = {name: part.values.get(i) for name, i in part.scope.items()}
        return given(part.formula, {name: scalar(text) for name, text in texts.items() if text is not None})

    def values(self, names: Mapping[str, int], values: Values) -> str:
        """What variables stand for."""
        return ", ".join(f"{name} = {values[i] or 'any other value'}" for name, i in names.items() if i in values)

    def held(self, times: Sequence[int], steps: Sequence[int], *, holds: bool) -> str:
        """That something held at steps, or did not; `steps` is empty where only the time of one is known."""
        if self._is_now(times, steps):
            return f"{'holds' if holds else 'does not hold'} {self.at(times, steps)}"
        if len(times) > 1 and not holds:
            return "held " + self.at(times, steps).replace("at each", "at none", 1)
        return f"{'held' if holds else 'did not hold'} {self.at(times, steps)}"

    def at(self, times: Sequence[int], steps: Sequence[int]) -> str:
        """At which steps."""
        if len(times) == 1:
            return self._at_one(times[0], steps[0] if steps else None)
        if self._time == "seconds":
            first, last = self.ago(times[0]), self.ago(times[-1])
            return f"at each of {len(times)} steps " + (first if first == last else f"between {first} and {last}")
        if self.is_unnumbered(times[-1]):
            return f"{self.at(times[:-1], steps[:-1])} and {_ATTEMPT}"
        return f"at each of {self._recall.noun}s {_shown(_ranges(times))}"

    def step(self, step: int) -> str:
        """A remembered step by its number and time; at a deadline, by its event too: it is that one's deadline."""
        seen = self._recall.seen(step)
        if seen is None:
            return f"{self._recall.noun} {step}"
        at = step_name(seen.number, seen.stamp, self._stamp)
        if not seen.event:
            return f"the deadline ({at})"
        if seen.number is None:
            return f"this attempt ({at})"
        return f"{at}, {seen.event}" if self.is_tick else at

    def during(self, first: int, last: int) -> str:
        """Among which steps, as seen from another step than the present one."""
        if self.is_unnumbered(last):
            return f"{self.during(first, last - 1)} and {_ATTEMPT}" if last > first else _ATTEMPT
        if self._time == "steps":
            noun = self._recall.noun
            return f"in {noun}s {_range(first, last)}" if last > first else f"in {noun} {first}"
        return f"between {self.ago(first)} and {self.ago(last)}" if last > first else f"at {self._at_time(first)}"

    def among(self, spans: Sequence[tuple[int, int]]) -> str:
        """Among the steps of several spans, with `time: steps`."""
        *before, (first, last) = spans
        if not before:
            return self.during(first, last)
        if not self.is_unnumbered(last):
            return f"in {self._recall.noun}s {_shown(spans)}"
        return (
            f"in {self._recall.noun}s {_shown([*before, (first, last - 1)] if last > first else before)} and {_ATTEMPT}"
        )

    def window(self, bound: Bound) -> str:
        """A window as seen from the present step."""
        first, last = self.ends(bound)
        if self._time == "steps":
            return "before there were steps" if last < first else self.during(first, last)
        near, far = duration(bound.lower), None if bound.upper is None else duration(bound.upper)
        if far is None:
            return f"{near} ago or earlier" if bound.lower else "so far"
        return f"between {near} and {far} ago" if bound.lower else f"in the last {far}"

    def ends(self, bound: Bound, seen_from: int | None = None) -> tuple[int, int]:
        """The first and the last time in a window, as seen from the present one unless from another.

        The last is earlier where there were no such steps.
        """
        now = self._now if seen_from is None else seen_from
        first = 1 if bound.upper is None else max(1, now - bound.upper)
        return first, now - bound.lower

    def ago(self, time: int) -> str:
        """How long before the present step a time was."""
        return "now" if time == self._now else f"{duration(self._now - time)} ago"

    def is_unnumbered(self, time: int) -> bool:
        """Whether this is the number of an attempt that is taken back: another step will have it."""
        return self._attempt and self._time == "steps" and time == self._now

    def numbered(self, first: int, last: int) -> tuple[int, int] | None:
        """The part of a window that has numbers of its own, None where there is none."""
        last -= self.is_unnumbered(last)
        return (first, last) if first <= last else None

    def _is_now(self, times: Sequence[int], steps: Sequence[int]) -> bool:
        """Whether this is the present step."""
        return len(times) == 1 and (steps[0] == self._recall.last if steps else times[0] == self._now)

    def _at_one(self, time: int, step: int | None) -> str:
        if self._time == "steps":
            return f"at {self.step(time)}"
        if step is None or self._recall.seen(step) is None:
            return f"at {self._at_time(time)}"
        ago = "" if step == self._recall.last else f", {self.ago(time)}"
        return f"at {self.step(step)}{ago}"

    def _at_time(self, time: int) -> str:
        return "this step" if time == self._now else f"a step {duration(self._now - time)} ago"


def named(formula: Formula, time: Time) -> str:
    """A formula with the names of its parts; where it has a name itself, behind that."""
    text = render(formula, time, named=True)
    return text if formula.written is None else f"{formula.written}: {text}"


def scalar(text: Text) -> Scalar | None:
    """The value of a canonical text, None for the fresh one."""
    if text is None:
        return None
    value: Scalar = json.loads(text)
    return value


def _range(first: int, last: int) -> str:
    return f"{first}–{last}" if first != last else str(first)  # noqa: RUF001 -- a range


def _shown(ranges: Sequence[tuple[int, int]]) -> str:
    """The first of some ranges, and how many more there are."""
    shown = ", ".join(_range(*each) for each in ranges[:_MOST_RANGES])
    if len(ranges) > _MOST_RANGES:
        shown += f" and {len(ranges) - _MOST_RANGES} more times up to {ranges[-1][1]}"
    return shown


def _ranges(times: Sequence[int]) -> list[tuple[int, int]]:
    ranges: list[tuple[int, int]] = []
    for time in times:
        if ranges and time == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], time)
        else:
            ranges.append((time, time))
    return ranges


def given(formula: Formula, values: Mapping[str, Scalar | None]) -> Formula:
    """The formula with values in place of its free variables."""
    if not values:
        return formula
    written = _called(formula.written, values)
    match formula:
        case Atom(constraints):
            return replace(formula, constraints=tuple(_given(c, values) for c in constraints), written=written)
        case tree.Relation(left, _, right):
            return replace(formula, left=_side(left, values), right=_side(right, values), written=written)
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            inner = {name: value for name, value in values.items() if name != variable}
            return replace(formula, body=given(body, inner), written=written)
        case _:
            return replace(tree.rebuilt(formula, lambda part: given(part, values)), written=written)


def _called(call: Call | None, values: Mapping[str, Scalar | None]) -> Call | None:
    """A name with values in place of its variables."""
    if call is None or not call.arguments:
        return call
    found = [(name, values.get(name)) for name in call.arguments]
    return Call(call.name, tuple(name if value is None else render_value(value) for name, value in found))


def _given(constraint: Constraint, values: Mapping[str, Scalar | None]) -> Constraint:
    if not isinstance(constraint.value, Ref | Limit):
        return constraint
    value = values.get(constraint.value.name)
    return constraint if value is None else Constraint(constraint.key, constraint.op, value)


def _side(side: Ref | Scalar, values: Mapping[str, Scalar | None]) -> Ref | Scalar:
    value = values.get(side.name) if isinstance(side, Ref) else None
    return side if value is None else value


def duration(nanoseconds: int) -> str:
    """A time span in its unit, exactly."""
    for unit, digits in (("s", 9), ("ms", 6), ("us", 3)):
        size = 10**digits
        if nanoseconds >= size or nanoseconds % size == 0:
            whole, rest = divmod(nanoseconds, size)
            return f"{whole}.{rest:0{digits}}".rstrip("0").rstrip(".") + unit
    return f"{nanoseconds}ns"
