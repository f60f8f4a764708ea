"""Steps that wait for the answers of external oracles: asked in their order, judged in their order."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

from oracle_server.core.engine import Answer
from oracle_server.core.events import Order, Step
from oracle_server.core.verdicts import Outcome


class Ask(NamedTuple):
    """A question to the oracle of one property, by its index: how it stands at a step and a time (ns).

    `number` identifies the waiting step; times never go back within an order.
    """

    number: int
    order: Order
    property: int
    step: Step
    time: int


@dataclass(slots=True)
class Waiting:
    """A step whose turn has come, with its answers so far; `missing` are the properties without one."""

    order: Order
    step: Step
    missing: set[int]
    answers: dict[int, Answer] = field(default_factory=dict)


class Ticks(NamedTuple):
    """Deadlines up to a time (ns) that have expired, and wait behind a step."""

    order: Order
    until: int


class Asking:
    """A queue of the steps that wait for answers, and of what waits behind them; nothing overtakes."""

    def __init__(self) -> None:
        self._asks: list[Ask] = []
        self._queue: deque[Waiting | Ticks] = deque()
        self._unanswered: dict[int, Waiting] = {}
        self._count = 0
        self.latest: dict[Order, int] = {}
        """The time (ns) that the last step had in each order."""

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def first(self) -> Waiting | None:
        """The step that has waited longest, None where none waits."""
        return next((item for item in self._queue if isinstance(item, Waiting)), None)

    @property
    def last(self) -> Step | None:
        """The step that came last, None where none waits."""
        return next((item.step for item in reversed(self._queue) if isinstance(item, Waiting)), None)

    def add(self, order: Order, step: Step, properties: Iterable[int], time: int) -> None:
        """Let a step wait for the oracles of some properties, possibly none."""
        self._count += 1
        self.latest[order] = time
        waiting = Waiting(order, step, set(properties))
        self._queue.append(waiting)
        if waiting.missing:
            self._unanswered[self._count] = waiting
        self._asks += [Ask(self._count, order, index, step, time) for index in sorted(waiting.missing)]

    def add_ticks(self, order: Order, until: int) -> None:
        """Let expired deadlines wait behind the last step."""
        last = self._queue[-1] if self._queue else None
        if isinstance(last, Ticks) and last.order == order:
            self._queue.pop()
            until = max(until, last.until)
        self._queue.append(Ticks(order, until))

    def take(self) -> list[Ask]:
        """The questions that were not taken yet, in their order."""
        asks, self._asks = self._asks, []
        return asks

    def answer(self, number: int, index: int, answer: Answer) -> None:
        """Add an answer; one that is not awaited is ignored."""
        waiting = self._unanswered.get(number)
        if waiting is not None and index in waiting.missing:
            waiting.missing.remove(index)
            waiting.answers[index] = answer
            if not waiting.missing:
                del self._unanswered[number]

    def give_up(self, reason: str) -> None:
        """Stop waiting: the outcome of every missing answer is unknown."""
        self._asks.clear()
        for waiting in self._unanswered.values():
            waiting.answers |= dict.fromkeys(waiting.missing, Answer(Outcome.UNKNOWN, reason))
            waiting.missing.clear()
        self._unanswered.clear()

    def leaving(self) -> Iterator[Waiting | Ticks]:
        """Remove what does not wait any more, in its order."""
        while self._queue:
            first = self._queue[0]
            if isinstance(first, Waiting) and first.missing:
                return
            yield self._queue.popleft()
