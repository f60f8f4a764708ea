"""Whether what was asked about passes: as the oracle decides, or by policy while it does not."""

from __future__ import annotations

import threading
from collections import deque
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Callable, Deque, Mapping, Optional, Tuple

from oracle_adapter.kinds import KINDS

if TYPE_CHECKING:
    from oracle_adapter.board import Board
    from oracle_adapter.decision import Answer
    from oracle_adapter.exchange import Stamp, Then
    from oracle_adapter.link import Link


GRACE = 5.0
"""Seconds beyond `decide_within` in which the link answers, unless its thread hangs."""


class Passing:
    """What becomes of the events of one filtered stream, which the server has described."""

    def __init__(self, link: Link, board: Board, stream: Mapping[str, Any]) -> None:
        self._link, self._board = link, board
        self._name, self._kind = stream["name"], KINDS[stream["kind"]]
        self._within = stream["decide_within"] / 10**9
        self._policy = stream["on_unavailable"]

    def ask(self, stamp: Stamp, data: Any, then: Then, **more: Any) -> None:
        """Ask about an event; `then` and `more` are what `Link.ask_then` takes."""
        self._link.ask_then(
            self._name, self._kind.name, stamp, data, then, decide_within=self._within, **more
        )

    def settle(
        self, answer: Answer, give: Callable[[Any], bool], what: Any, call: Optional[int] = None
    ) -> Tuple[bool, str]:
        """Whether it passed, and why not, in words; the server is told what was done.

        What may pass is given to `give`, which says whether it went on: an adapter that ends, or
        makes room for another, forwards nothing more, and history must not say that it did. What
        `give` raises goes no further: the event did not pass.
        """
        event = f"a {self._kind.event} of {self._name}"
        if self._kind.has_call:
            event += f", call {call}"
        may, why = self._board.settle(answer, self._policy, event)
        passed, reason = False, ", ".join(answer.denied_by) or answer.reason or "the monitor ends"
        if may:
            try:
                passed = give(what)
            except Exception as error:  # noqa: BLE001 - others wait behind this one
                reason = f"it could not be passed on: {error!r}"
                self._board.failed(self._name, event, error)
        self._link.handled(answer, passed, why)
        return passed, reason

    def ask_and_wait(
        self, stamp: Stamp, data: Any, call: int, then: Callable[[], None]
    ) -> Tuple[bool, str]:
        """Ask about a call, call `then`, and wait for what `settle` returns.

        Where the link's thread hangs, the wait ends `GRACE` seconds after the time for a decision;
        then the call does not pass, whatever the answer will be.
        """
        settled: SimpleQueue[Tuple[bool, str]] = SimpleQueue()
        passed = threading.Lock()  # taken by what comes first: the answer, or the end of the wait

        def answered(answer: Answer) -> None:
            settled.put(self.settle(answer, lambda _: passed.acquire(blocking=False), None, call))

        self.ask(stamp, data, answered, call=call)
        then()
        try:
            return settled.get(timeout=self._within + GRACE)
        except Empty:
            if passed.acquire(blocking=False):
                return False, "there is no answer from the link"
            return True, ""


class _Waiting:
    __slots__ = ("answer", "message")

    def __init__(self, message: Any) -> None:
        self.message = message
        self.answer: Optional[Answer] = None


class Gate:
    """Forwards what may pass of a topic, in its order; nobody waits for a decision."""

    def __init__(self, passing: Passing, forward: Callable[[Any], bool]) -> None:
        """Call `forward` with each message that may pass, mostly in the link's thread.

        It says whether the message went on.
        """
        self._passing, self._forward = passing, forward
        self._waiting: Deque[_Waiting] = deque()
        self._entering, self._leaving = threading.Lock(), threading.Lock()

    def take(self, message: Any, stamp: Stamp, data: Any, **more: Any) -> None:
        """Ask about a message that came, from any thread; `more` is as for `Link.ask`."""
        waiting = _Waiting(message)

        def answered(answer: Answer) -> None:
            waiting.answer = answer
            self._settle()

        with self._entering:  # or two publishers' messages could change places on the way
            self._passing.ask(stamp, data, answered, **more)
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
                self._passing.settle(answer, self._forward, self._waiting.popleft().message)
