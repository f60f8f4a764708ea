"""The words of explanations."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Ref, Scalar
from oracle_server.engines.native.keys import Text
from oracle_server.engines.native.parts import Part, Values

_MOST_RANGES = 4


class Wording:
    """Tells steps and windows as seen from the present one; times are step numbers or, with `time: seconds`, ns."""

    def __init__(self, time: Time, now: int) -> None:
        self._time: Time = time
        self._now = now

    def formula(self, part: Part) -> str:
        """A part, with values in place of its variables."""
        values = {name: part.values[i] for name, i in part.scope.items() if part.values.get(i) is not None}
        return render(_with(part.formula, {name: scalar(text) for name, text in values.items()}), self._time)

    def values(self, names: Mapping[str, int], values: Values) -> str:
        """What variables stand for."""
        return ", ".join(f"{name} = {values[i] or 'any other value'}" for name, i in names.items() if i in values)

    def held(self, times: Sequence[int], *, holds: bool) -> str:
        """That something held at steps, or did not."""
        if self.is_now(times):
            return f"{'holds' if holds else 'does not hold'} {self.at(times)}"
        if len(times) > 1 and not holds:
            return "held " + self.at(times).replace("at each", "at none", 1)
        return f"{'held' if holds else 'did not hold'} {self.at(times)}"

    def at(self, times: Sequence[int]) -> str:
        """At which steps."""
        if self._time == "seconds":
            if len(times) == 1 or times[0] == times[-1]:
                return f"at {self._step(times[0])}"
            return f"at each of {len(times)} steps between {self._ago(times[0])} and {self._ago(times[-1])}"
        if len(times) == 1:
            return f"at step {times[0]}"
        ranges = _ranges(times)
        shown = ", ".join(f"{a}–{b}" if a != b else str(a) for a, b in ranges[:_MOST_RANGES])  # noqa: RUF001
        more = f" and {len(ranges) - _MOST_RANGES} more times up to {times[-1]}" if len(ranges) > _MOST_RANGES else ""
        return f"at each of steps {shown}{more}"

    def during(self, first: int, last: int) -> str:
        """Among which steps, as seen from another step than the present one."""
        if self._time == "steps":
            return f"in steps {first}–{last}" if last > first else f"in step {first}"  # noqa: RUF001 -- a range
        return f"between {self._ago(first)} and {self._ago(last)}" if last > first else f"at {self._step(first)}"

    def window(self, bound: Bound) -> str:
        """A window as seen from the present step."""
        first, last = self.ends(bound)
        if self._time == "steps":
            return "before there were steps" if last < first else self.during(first, last)
        near, far = _duration(bound.lower), None if bound.upper is None else _duration(bound.upper)
        if far is None:
            return f"{near} ago or earlier" if bound.lower else "so far"
        return f"between {near} and {far} ago" if bound.lower else f"in the last {far}"

    def ends(self, bound: Bound) -> tuple[int, int]:
        """The first and the last time in a window; the last is earlier where there were no such steps."""
        first = 1 if bound.upper is None else max(1, self._now - bound.upper)
        return first, self._now - bound.lower

    def is_now(self, times: Sequence[int]) -> bool:
        """Whether this is the present step."""
        return len(times) == 1 and times[0] == self._now

    def _step(self, time: int) -> str:
        return "this step" if time == self._now else f"a step {_duration(self._now - time)} ago"

    def _ago(self, time: int) -> str:
        return "now" if time == self._now else f"{_duration(self._now - time)} ago"


def scalar(text: Text) -> Scalar | None:
    """The value of a canonical text, None for the fresh one."""
    if text is None:
        return None
    value: Scalar = json.loads(text)
    return value


def _ranges(times: Sequence[int]) -> list[tuple[int, int]]:
    ranges: list[tuple[int, int]] = []
    for time in times:
        if ranges and time == ranges[-1][1] + 1:
            ranges[-1] = (ranges[-1][0], time)
        else:
            ranges.append((time, time))
    return ranges


def _with(formula: Formula, values: Mapping[str, Scalar | None]) -> Formula:
    """The formula with values in place of its free variables."""
    match formula:
        case Atom(constraints):
            return Atom(tuple(_given(c, values) for c in constraints))
        case tree.Not(operand) | tree.Pre(operand):
            return type(formula)(_with(operand, values))
        case tree.And(left, right) | tree.Or(left, right) | tree.Implies(left, right):
            return type(formula)(_with(left, values), _with(right, values))
        case tree.Once(operand, bound) | tree.Historically(operand, bound):
            return type(formula)(_with(operand, values), bound)
        case tree.Since(left, right, bound):
            return tree.Since(_with(left, values), _with(right, values), bound)
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            inner = {name: value for name, value in values.items() if name != variable}
            return type(formula)(variable, _with(body, inner))


def _given(constraint: Constraint, values: Mapping[str, Scalar | None]) -> Constraint:
    if not isinstance(constraint.value, Ref):
        return constraint
    value = values.get(constraint.value.name)
    return constraint if value is None else Constraint(constraint.key, "==", value)


def _duration(nanoseconds: int) -> str:
    for unit, size in (("s", 10**9), ("ms", 10**6), ("us", 10**3)):
        if nanoseconds >= size or nanoseconds % size == 0:
            return f"{nanoseconds / size:.9g}{unit}"
    return f"{nanoseconds}ns"
