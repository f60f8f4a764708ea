"""Whether what was asked about passes: as the oracle decides, or by policy while it does not."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Callable, Deque, Mapping, Optional, Tuple

from oracle_adapter.decision import should_pass

if TYPE_CHECKING:
    from concurrent.futures import Future

    from oracle_adapter.decision import Answer
    from oracle_adapter.exchange import Stamp
    from oracle_adapter.link import Link

Tell = Callable[[str], None]


class Passing:
    """What becomes of the events of one filtered stream.

    `stream` is the server's description of it. `tell` hears of every denial, and once per outage
    of what happens without decisions.
    """

    def __init__(self, link: Link, stream: Mapping[str, Any], tell: Tell) -> None:
        self._link, self._tell = link, tell
        self._name, self._kind = stream["name"], stream["kind"]
        self._within = stream["decide_within"] / 10**9
        self._policy = stream["on_unavailable"]
        self._undecided = 0  # in this outage

    def ask(self, stamp: Stamp, data: Any, **more: Any) -> Future[Answer]:
        """Ask about an event; `more` is what `Link.ask` takes besides."""
        return self._link.ask(
            self._name, self._kind, stamp, data, decide_within=self._within, **more
        )

    def settle(self, answer: Answer) -> Tuple[bool, str]:
        """Whether it passes, and why not, in words; the server is told what was done."""
        passed, why = should_pass(answer, self._policy)
        reason = ", ".join(answer.denied_by) or answer.reason
        if why == "decision":
            if self._undecided:
                self._tell(f"{self._name}: decided again, after {self._undecided} without")
            self._undecided = 0
            if not passed:
                self._tell(f"denied a {self._word} of {self._name}: {reason}")
        else:
            self._undecided += 1
            if self._undecided == 1:
                done = "passes" if passed else "is denied"
                self._tell(f"no decision on a {self._word} of {self._name}, which {done}: {reason}")
        self._link.outcome(answer, passed, why)
        return passed, reason

    @property
    def _word(self) -> str:
        return "message" if self._kind == "topic" else self._kind


class Gate:
    """Forwards what may pass of a topic, in its order; nobody waits for a decision."""

    def __init__(self, passing: Passing, forward: Callable[[Any], None]) -> None:
        """Call `forward` with each message that passes, mostly in the link's thread."""
        self._passing, self._forward = passing, forward
        self._waiting: Deque[Tuple[Any, Future[Answer]]] = deque()
        self._entering, self._leaving = threading.Lock(), threading.Lock()

    def take(self, message: Any, stamp: Stamp, data: Any, *, source: Optional[str] = None) -> None:
        """Ask about a message that came, from any thread."""
        with self._entering:  # or two publishers' messages could change places on the way
            answer = self._passing.ask(stamp, data, source=source)
            self._waiting.append((message, answer))
        answer.add_done_callback(self._settle)

    def _settle(self, _: Future[Answer]) -> None:
        """Settle the messages at the head of the queue whose answers are there."""
        with self._leaving:
            while self._waiting and self._waiting[0][1].done():
                message, answer = self._waiting.popleft()
                passed, _reason = self._passing.settle(answer.result())
                if passed:
                    self._forward(message)
