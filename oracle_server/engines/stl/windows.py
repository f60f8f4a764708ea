"""Bounded past operators on robustness, for either clock.

rtamt's own go through their whole window at every sample; its monitors of dense time fail, or differ from its own
semantics, where bounded operators are nested. These cost a constant, amortised.
"""

from __future__ import annotations

import math
from collections import deque


class Position:
    """Where the present sample stands: its number, or its time in nanoseconds."""

    __slots__ = ("now",)

    def __init__(self) -> None:
        self.now = 0


class Since:
    """`φ since[begin:end] ψ`: the largest of ψ at samples in the window, each no more than φ's least value after it."""

    def __init__(self, clock: Position, begin: int, end: int) -> None:
        self._clock, self._begin, self._end = clock, begin, end
        self._count = 0
        self._least: deque[tuple[int, float]] = deque()
        """φ by number of the sample, each the least since it, rising."""
        self._young: deque[tuple[int, int, float]] = deque()
        """ψ by number and time, of samples that the window has not reached yet."""
        self._window: deque[tuple[int, float]] = deque()
        """What each sample in the window is good for, by time, falling: what a later one surpasses is left out."""

    def update(self, left: float, right: float) -> float:
        """Add a sample of φ and ψ; returns the robustness at it."""
        now = self._clock.now
        self._cap(left)
        self._young.append((self._count, now, right))
        while self._young and self._young[0][1] <= now - self._begin:
            self._enter(*self._young.popleft())
        while self._window and self._window[0][0] < now - self._end:
            self._window.popleft()
        return self._window[0][1] if self._window else -math.inf

    def _cap(self, left: float) -> None:
        self._count += 1
        while self._least and self._least[-1][1] >= left:
            self._least.pop()
        self._least.append((self._count, left))
        capped = None
        while self._window and self._window[0][1] > left:
            capped = self._window.popleft()[0]
        if capped is not None:
            self._window.appendleft((capped, left))

    def _enter(self, number: int, time: int, right: float) -> None:
        while self._least and self._least[0][0] <= number:
            self._least.popleft()
        value = min(right, self._least[0][1]) if self._least else right
        while self._window and self._window[-1][1] <= value:
            self._window.pop()
        self._window.append((time, value))


class Once:
    """`once[begin:end] φ`."""

    def __init__(self, clock: Position, begin: int, end: int) -> None:
        self._since = Since(clock, begin, end)

    def update(self, sample: float) -> float:
        """Add a sample; returns the robustness at it."""
        return self._since.update(math.inf, sample)


class Historically:
    """`historically[begin:end] φ`."""

    def __init__(self, clock: Position, begin: int, end: int) -> None:
        self._since = Since(clock, begin, end)

    def update(self, sample: float) -> float:
        """Add a sample; returns the robustness at it."""
        return -self._since.update(math.inf, -sample)


class Iff:
    """`φ iff ψ`, as rtamt has it; 0 where both are infinite with one sign, where rtamt would return NaN."""

    def update(self, left: float, right: float) -> float:
        """The robustness at a sample."""
        return 0.0 if left == right else -abs(left - right)


class Xor:
    """`φ xor ψ`, in the same way."""

    def update(self, left: float, right: float) -> float:
        """The robustness at a sample."""
        return 0.0 if left == right else abs(left - right)
