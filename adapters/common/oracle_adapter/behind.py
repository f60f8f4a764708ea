"""What must not overtake what came before it: a goal's result comes behind the goal's feedback."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from typing import Any, Callable, Deque, Dict, FrozenSet, Hashable, List, NamedTuple, Set

LONGEST = 1.0
"""Seconds that something waits at most for what came before it."""

Call = Callable[[], object]


class _Waiting(NamedTuple):
    goal: Hashable
    before: FrozenSet[int]
    since: float
    call: Call


class Behind:
    """All of it may be called in any thread; what waits is called by who settles the last of it."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock`: seconds."""
        self._clock = clock
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()  # guards what follows
        self._open: Dict[Any, Set[int]] = {}
        self._waiting: Deque[_Waiting] = deque()

    def came(self, goal: Hashable) -> int:
        """Something of a goal has come; returns the number for `settle`."""
        with self._lock:
            number = next(self._numbers)
            self._open.setdefault(goal, set()).add(number)
        return number

    def settle(self, goal: Hashable, number: int) -> None:
        """It was passed on, or will not be; nothing where that is known."""
        with self._lock:
            left = self._open.get(goal)
            if left is None:
                return
            left.discard(number)
            if not left:
                del self._open[goal]
            if not self._waiting:
                return
        self._call(lambda one: not one.before & self._left(one.goal))

    def after(self, goal: Hashable, call: Call) -> None:
        """Call something once all is settled that has come of a goal by now: mostly at once."""
        with self._lock:
            before = frozenset(self._open.get(goal, ()))
            if before:
                self._waiting.append(_Waiting(goal, before, self._clock(), call))
        if not before:
            call()

    def catch_up(self) -> None:
        """Go on with what has waited for `LONGEST`; to be called often."""
        if self._waiting:
            now = self._clock()
            self._call(lambda one: now - one.since >= LONGEST)

    def release(self) -> None:
        """Go on with all that waits."""
        self._call(lambda _: True)

    def _left(self, goal: Hashable) -> Set[int]:
        return self._open.get(goal, set())

    def _call(self, may: Callable[[_Waiting], bool]) -> None:
        with self._lock:
            held, self._waiting = self._waiting, deque()
            ready: List[_Waiting] = []
            for one in held:
                (ready if may(one) else self._waiting).append(one)
        for one in ready:
            one.call()
