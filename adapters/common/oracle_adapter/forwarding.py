"""Messages of a filtered topic, from their arrival until they are passed on or denied."""

from __future__ import annotations

import threading
from collections import deque
from functools import partial
from typing import TYPE_CHECKING, Any, Callable, Deque, Optional

if TYPE_CHECKING:
    from oracle_adapter.decision import Answer
    from oracle_adapter.exchange import Stamp
    from oracle_adapter.passing import Passing, TakeBack


ROOM = 1 << 28
"""Bytes of the messages that wait."""
FEW = 10
"""As many may wait whatever they take."""


class CrowdedOutError(Exception):
    """A message was given up while it waited for its decision."""

    def __init__(self) -> None:
        text = f"more than {ROOM >> 20} MiB waited for decisions, and it was among the oldest"
        super().__init__(text)


class _Waiting:
    __slots__ = ("answer", "call", "given_up", "goal_id", "message")

    def __init__(self, message: Any, call: Optional[int], goal_id: str) -> None:
        self.message, self.call, self.goal_id = message, call, goal_id
        self.answer: Optional[Answer] = None
        self.given_up = False


class _Room:
    """What waits, in order of arrival, with the bytes that it takes; the oldest is given up."""

    def __init__(self, size: Callable[[Any], int]) -> None:
        self._size, self._taken = size, 0
        self._lock = threading.Lock()
        self._held: Deque[_Waiting] = deque()

    def enter(self, waiting: _Waiting) -> None:
        with self._lock:
            self._held.append(waiting)
            self._taken += self._size(waiting.message)
            while self._taken > ROOM and len(self._held) > FEW:
                oldest = self._leave()
                oldest.message, oldest.given_up = None, True

    def leave(self, waiting: _Waiting) -> None:
        """Have the oldest leave, which may have been given up before."""
        with self._lock:
            if not waiting.given_up:
                self._leave()

    def _leave(self) -> _Waiting:
        oldest = self._held.popleft()
        self._taken -= self._size(oldest.message)
        return oldest


def _crowded_out(_: Any) -> bool:
    raise CrowdedOutError


class ForwardQueue:
    """Forwards what may pass of a topic, in order of arrival; no caller waits for a decision."""

    def __init__(
        self,
        passing: Passing,
        forward: Callable[[Any], bool],
        withheld: Optional[Callable[[Any, str], None]] = None,
        before: Optional[Callable[[Any, TakeBack], object]] = None,
        size: Callable[[Any], int] = lambda _: 0,
    ) -> None:
        """Call `forward` with each message that may pass, mostly in the link's thread.

        It returns whether the message was passed on. `withheld` is called with each that was not,
        and a text why; `before`, before it may pass, with each and what takes it back. `size` tells
        how many bytes a message takes: of too many the oldest do not pass, and are None by then.
        """
        self._room = _Room(size)
        self._before = before
        self._passing, self._forward, self._withheld = passing, forward, withheld
        self._waiting: Deque[_Waiting] = deque()
        self._entering, self._leaving = threading.Lock(), threading.Lock()

    def take(self, message: Any, stamp: Stamp, data: Any, **more: Any) -> None:
        """Ask about a message that came, from any thread; `more` is as for `Link.ask`."""
        waiting = _Waiting(message, more.get("call"), more.get("goal_id") or "")

        def answered(answer: Answer) -> None:
            waiting.answer = answer
            self._settle()

        with self._entering:  # or two publishers' messages could change places on the way
            self._passing.ask(stamp, data, answered, **more)
            self._room.enter(waiting)
            self._waiting.append(waiting)
        if waiting.answer is not None:  # before it had its place
            self._settle()

    def _settle(self) -> None:
        """Settle the messages at the head of the queue whose answers are there."""
        with self._leaving:
            while self._waiting:
                answer = self._waiting[0].answer
                if answer is None:
                    break
                head = self._waiting.popleft()
                self._room.leave(head)
                forward = _crowded_out if head.given_up else self._forward
                if self._before is not None:
                    self._before(head.message, partial(self._passing.take_back, answer))
                passed, why = self._passing.settle(
                    answer, forward, head.message, head.call, head.goal_id
                )
                if not passed and self._withheld is not None:
                    self._withheld(head.message, why)
