"""What patterns and requirements say in English, read literally over a trace: slow, plain, and without any formula.

A span is a run of steps within which a sentence is in force. Both readings tell, for each step, the steps that broke
the sentence there: of what only looks back the step itself, of what is awaited the steps that asked for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

SECOND = 10**9


class Step(NamedTuple):
    """Its time in whole seconds, and the letters of what holds at it."""

    time: int
    letters: str


class Trace(NamedTuple):
    """Steps, and whether distances are those of their times."""

    steps: Sequence[Step]
    timed: bool

    def has(self, n: int, letter: str) -> bool:
        return letter in self.steps[n].letters

    def near(self, first: int, last: int, most: int | None) -> bool:
        """Whether a step is at most so far behind another one."""
        if most is None:
            return True
        distance = self.steps[last].time - self.steps[first].time if self.timed else last - first
        return distance <= most

    def over(self, first: int, now: int, most: int | None) -> bool:
        """Whether no step that is still to come can be at most so far behind."""
        if most is None:
            return False
        return not self.near(first, now, most) if self.timed else now - first >= most


Spans = list[int | None]
"""Of each step the first one of its span, None where it is in none."""


def runs(inside: Sequence[bool]) -> Spans:
    found: Spans = []
    for n, within in enumerate(inside):
        begun = found[-1] if found and found[-1] is not None else n
        found.append(begun if within else None)
    return found


def globally(trace: Trace) -> Spans:
    return [0] * len(trace.steps)


def after(trace: Trace) -> Spans:
    """The event that opens a scope is within it."""
    return runs([any(trace.has(k, "p") for k in range(n + 1)) for n in range(len(trace.steps))])


def until(trace: Trace) -> Spans:
    """The event that closes a scope is not within it."""
    return runs([not any(trace.has(k, "q") for k in range(n + 1)) for n in range(len(trace.steps))])


def between(trace: Trace) -> Spans:
    """It opens again and again; an event that opens and closes opens, or leaves open."""
    inside, now = [], False
    for n in range(len(trace.steps)):
        now = trace.has(n, "p") or (now and not trace.has(n, "q"))
        inside.append(now)
    return runs(inside)


def while_(trace: Trace) -> Spans:
    return runs([trace.has(n, "m") for n in range(len(trace.steps))])


def unless(trace: Trace) -> Spans:
    return runs([not trace.has(n, "m") for n in range(len(trace.steps))])


def before_mode(trace: Trace) -> Spans:
    return runs([not any(trace.has(k, "m") for k in range(n + 1)) for n in range(len(trace.steps))])


def after_mode(trace: Trace) -> Spans:
    """From the first step on at which the mode is over."""
    ended = [n for n in range(1, len(trace.steps)) if trace.has(n - 1, "m") and not trace.has(n, "m")]
    return runs([bool(ended) and n >= ended[0] for n in range(len(trace.steps))])


Broken = list[set[int]]


def _looking(trace: Trace, spans: Spans, broken: Callable[[int, int], bool]) -> Broken:
    """The steps that break by themselves, given themselves and the first one of their span."""
    found: Broken = []
    for n in range(len(trace.steps)):
        first = spans[n]
        found.append({n} if first is not None and broken(n, first) else set())
    return found


def _asking(trace: Trace, triggers: Iterator[int], broken: Callable[[int, int], bool]) -> Broken:
    """The triggers that are broken as of each step, each at the first one."""
    asked, found, told = [*triggers], [], set[int]()
    for now in range(len(trace.steps)):
        new = {i for i in asked if i <= now and i not in told and broken(i, now)}
        found.append(new)
        told |= new
    return found


def absence(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """A b within d of the opening."""
    return _looking(trace, spans, lambda n, first: trace.has(n, "b") and trace.near(first, n, most))


def _comes_after(trace: Trace, spans: Spans, n: int, first: int, most: int | None) -> bool:
    return any(trace.has(k, "a") and spans[k] == first and trace.near(k, n, most) for k in range(n + 1))


def precedence(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """A b without an a at it or before it in its span."""
    return _looking(trace, spans, lambda n, first: trace.has(n, "b") and not _comes_after(trace, spans, n, first, most))


def prevention(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """A b with an a at it or before it in its span."""
    return _looking(trace, spans, lambda n, first: trace.has(n, "b") and _comes_after(trace, spans, n, first, most))


def universality(trace: Trace, spans: Spans, _: int | None) -> Broken:
    return _looking(trace, spans, lambda n, _: not trace.has(n, "b"))


def _unanswered(trace: Trace, spans: Spans, most: int | None) -> Callable[[int, int], bool]:
    def broken(i: int, now: int) -> bool:
        for j in range(i, now + 1):
            if spans[j] != spans[i]:
                return True
            if trace.has(j, "b") and trace.near(i, j, most):
                return False
        return trace.over(i, now, most)

    return broken


def response(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """An a without a b at it or after it, in its span and in time."""
    asked = (n for n in range(len(trace.steps)) if spans[n] is not None and trace.has(n, "a"))
    return _asking(trace, asked, _unanswered(trace, spans, most))


def existence(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """A span without a b, in time."""
    asked = (n for n in range(len(trace.steps)) if spans[n] == n)
    return _asking(trace, asked, _unanswered(trace, spans, most))


def existence_until(trace: Trace, spans: Spans, most: int | None) -> Broken:
    """The same of the scope that is open when the session begins, and ends with its first step if that closes it."""
    closed = spans[0] is None
    return [{0}, *(set[int]() for _ in trace.steps[1:])] if closed else existence(trace, spans, most)


def triggers(trace: Trace, spans: Spans, condition: str) -> set[int]:
    """The steps at which a requirement asks: the first of each span, each with a c, or each where c begins in it."""
    steps = [n for n in range(len(trace.steps)) if spans[n] is not None]
    if not condition:
        return {n for n in steps if spans[n] == n}
    held = {n for n in steps if trace.has(n, "c")}
    if condition == "whenever":
        return held
    return {n for n in held if spans[n] == n or not trace.has(n - 1, "c")}


class Asked(NamedTuple):
    """What a requirement says before its timing, and how long it takes."""

    trace: Trace
    spans: Spans
    triggers: set[int]
    most: int | None

    def before(self, n: int, first: int) -> list[int]:
        """The triggers of a span, up to a step of it."""
        return sorted(i for i in self.triggers if i <= n and self.spans[i] == first)

    def looking(self, broken: Callable[[int, int], bool]) -> Broken:
        return _looking(self.trace, self.spans, broken)

    def asking(self, broken: Callable[[int, int], bool]) -> Broken:
        return _asking(self.trace, iter(sorted(self.triggers)), broken)

    def has(self, n: int, letter: str) -> bool:
        return self.trace.has(n, letter)


def immediately(asked: Asked) -> Broken:
    return asked.looking(lambda n, _: n in asked.triggers and not asked.has(n, "r"))


def at_next(asked: Asked) -> Broken:
    return asked.looking(
        lambda n, first: n - 1 in asked.triggers and asked.spans[n - 1] == first and not asked.has(n, "r")
    )


def always(asked: Asked) -> Broken:
    return asked.looking(lambda n, first: bool(asked.before(n, first)) and not asked.has(n, "r"))


def never(asked: Asked) -> Broken:
    return asked.looking(lambda n, first: bool(asked.before(n, first)) and asked.has(n, "r"))


def for_(asked: Asked) -> Broken:
    def broken(n: int, first: int) -> bool:
        near = [i for i in asked.before(n, first) if asked.trace.near(i, n, asked.most)]
        return bool(near) and not asked.has(n, "r")

    return asked.looking(broken)


def until_stop(asked: Asked) -> Broken:
    def broken(n: int, first: int) -> bool:
        going = [i for i in asked.before(n, first) if not any(asked.has(k, "s") for k in range(i, n + 1))]
        return bool(going) and not asked.has(n, "r")

    return asked.looking(broken)


def before_stop(asked: Asked) -> Broken:
    def broken(n: int, first: int) -> bool:
        missing = [i for i in asked.before(n, first) if not any(asked.has(k, "r") for k in range(i, n))]
        return asked.has(n, "s") and bool(missing)

    return asked.looking(broken)


def finally_(asked: Asked) -> Broken:
    """Told at the first step behind a span."""
    found: Broken = [set()]
    for n in range(1, len(asked.trace.steps)):
        first = asked.spans[n - 1]
        left = first is not None and asked.spans[n] != first
        wrong = left and asked.before(n - 1, first or 0) and not asked.has(n - 1, "r")
        found.append({n} if wrong else set())
    return found


def within(asked: Asked) -> Broken:
    """What its span's end leaves open is none."""

    def broken(i: int, now: int) -> bool:
        for j in range(i, now + 1):
            if not asked.trace.near(i, j, asked.most):
                return True
            if asked.spans[j] != asked.spans[i] or asked.has(j, "r"):
                return False
        return asked.trace.over(i, now, asked.most)

    return asked.asking(broken)


def after_steps(asked: Asked) -> Broken:
    most = asked.most or 0

    def broken(i: int, now: int) -> bool:
        for j in range(i, min(now, i + most + 1) + 1):
            if asked.spans[j] != asked.spans[i]:
                return False
            if asked.has(j, "r") is (j <= i + most):
                return True
        return False

    return asked.asking(broken)


def eventually(asked: Asked) -> Broken:
    """Broken by the end of its span alone."""

    def broken(i: int, now: int) -> bool:
        for j in range(i, now + 1):
            if asked.spans[j] != asked.spans[i]:
                return True
            if asked.has(j, "r"):
                return False
        return False

    return asked.asking(broken)
