"""What is known here of an action's goals: whose reply is not settled, and what was withheld of which."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Any, Callable, NamedTuple

from oracle_ros2.statuses import ABORTED, BEFORE, FINAL, Statuses

Goal = bytes
"""A goal's id: 16 bytes."""
MOST = 1000
"""Goals whose ends were told or withheld that are remembered; a server forgets them after 10 s, usually."""

UNASKED = 1.0
"""Seconds in which a client may ask for the result of a goal that has ended, before its end is told all the same."""


class _Unsettled(NamedTuple):
    """A goal whose client has no reply yet: when it came (ns), and what waits for the reply."""

    came: int
    waiting: list[Callable[[], Any]]


class Goals:
    """All of it may be called in any thread; `lock` is held where several things must go together."""

    def __init__(self) -> None:
        self.lock = threading.RLock()
        self._unsettled: dict[Goal, _Unsettled] = {}
        self._awaited: Counter[Goal] = Counter()
        self._deciding: Counter[Goal] = Counter()
        self._unasked: dict[Goal, float | None] = {}  # since when its end is there (s)
        self._told: dict[Goal, None] = {}
        self._refused: dict[Goal, None] = {}
        self._withheld: dict[Goal, None] = {}

    def begin(self, goal: Goal, now: int) -> None:
        """A goal has come (ns): nothing of it may be told before the reply."""
        with self.lock:
            self._unsettled.setdefault(goal, _Unsettled(now, []))

    def settle(self, goal: Goal) -> list[Callable[[], Any]]:
        """Its client has the reply; returns what waits for that."""
        with self.lock:
            settled = self._unsettled.pop(goal, None)
        return settled.waiting if settled is not None else []

    def is_unsettled(self, goal: Goal) -> bool:
        """Whether its client has no reply yet."""
        return goal in self._unsettled

    def renew(self, goal: Goal, *, decides_result: bool) -> None:
        """The server has taken a goal, whose id may have been that of another one.

        Where its result will be decided on its end is not told before somebody asks for that, for `UNASKED` at most.
        """
        with self.lock:
            for goals in (self._told, self._refused, self._withheld):
                goals.pop(goal, None)
            if decides_result:
                _remember(self._unasked, goal)

    def after_reply(self, goal: Goal, call: Callable[[], Any]) -> bool:
        """Have something called once its client has the reply; False where there is nothing to wait for."""
        with self.lock:
            unsettled = self._unsettled.get(goal)
            if unsettled is not None:
                unsettled.waiting.append(call)
            return unsettled is not None

    @property
    def unsettled(self) -> list[Goal]:
        """The goals whose clients have no reply yet."""
        with self.lock:
            return list(self._unsettled)

    def unsettled_by(self, stamp: int) -> list[Goal]:
        """Those of them that came no later (ns); all by 0."""
        with self.lock:
            return [goal for goal, unsettled in self._unsettled.items() if not stamp or unsettled.came <= stamp]

    def refuse(self, goal: Goal) -> None:
        """Its client is told that it was rejected, though the server has accepted it: tell nothing of it."""
        with self.lock:
            _remember(self._refused, goal)

    def is_refused(self, goal: Goal) -> bool:
        """Whether the client was told that the goal was rejected, though the server has accepted it."""
        return goal in self._refused

    def await_result(self, goal: Goal) -> None:
        """A result is to be decided on: how the goal ends is not told before."""
        with self.lock:
            self._unasked.pop(goal, None)
            self._awaited[goal] += 1

    def tell_unasked(self, statuses: Statuses, now: float) -> bool:
        """Let ends be told that nobody has asked about in time (s); whether there are some."""
        with self.lock:
            for goal, ended in list(self._unasked.items()):
                if ended is None and statuses.get(goal) in FINAL:
                    self._unasked[goal] = now
            late = [goal for goal, ended in self._unasked.items() if ended is not None and now - ended >= UNASKED]
            for goal in late:
                del self._unasked[goal]
                _remember(self._told, goal)
            return bool(late)

    def decide(self, goal: Goal) -> None:
        """The result is there, and is decided on: meanwhile the goal is shown as before, unless its end was told."""
        with self.lock:
            if goal not in self._told:
                self._deciding[goal] += 1

    def tell(self, goal: Goal) -> None:
        """A client has the result, or was told of the end."""
        with self.lock:
            _remember(self._told, goal)

    def decided(self, goal: Goal) -> None:
        """It is decided on, or will not be."""
        with self.lock:
            for goals in (self._awaited, self._deciding):
                goals[goal] -= 1
                if goals[goal] <= 0:
                    del goals[goal]

    def withhold(self, goal: Goal) -> None:
        """Its result is withheld for good."""
        with self.lock:
            _remember(self._withheld, goal)

    def is_withheld(self, goal: Goal) -> bool:
        """Whether its result was withheld."""
        return goal in self._withheld

    def may_show(self, statuses: Statuses) -> bool:
        """Whether statuses may be told: their goals' replies are settled, and results where there are some."""
        with self.lock:
            return self.have_replies(statuses) and not any(statuses.get(goal) in FINAL for goal in self._awaited)

    def have_replies(self, statuses: Statuses) -> bool:
        """Whether the clients of all goals of some statuses have their replies."""
        with self.lock:
            return not any(goal in statuses for goal in self._unsettled)

    def shown(self, statuses: Statuses) -> dict[Goal, int | None]:
        """Those of some statuses that are told otherwise, None for not at all."""
        with self.lock:
            hidden: dict[Goal, int | None] = {goal: None for goal in self._refused if goal in statuses}
            ended = (goal for goal in self._withheld if statuses.get(goal, ABORTED) in FINAL - {ABORTED})
            early = {
                goal: BEFORE[statuses[goal]]
                for goal in (*self._deciding, *self._unasked)
                if statuses.get(goal) in FINAL
            }
            return {**early, **dict.fromkeys(ended, ABORTED), **hidden}


def _remember(goals: dict[Goal, Any], goal: Goal) -> None:
    goals[goal] = None
    if len(goals) > MOST:
        del goals[next(iter(goals))]
