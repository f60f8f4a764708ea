"""Whether what was asked about passes: as the oracle decides, or by policy while it does not."""

from __future__ import annotations

import threading
from queue import Empty, SimpleQueue
from typing import TYPE_CHECKING, Any, Callable, Mapping, Optional, Tuple

from oracle_adapter.decision import should_pass
from oracle_adapter.kinds import KINDS

if TYPE_CHECKING:
    from oracle_adapter.board import Board
    from oracle_adapter.clocks import Clocks
    from oracle_adapter.decision import Answer, Policy
    from oracle_adapter.exchange import Stamp, Then
    from oracle_adapter.link import Link


TakeBack = Callable[[], None]
"""Reports that what passed went no further after all."""

GRACE = 5.0
"""Seconds beyond `decide_within` in which the link answers, unless its thread hangs."""


class Passing:
    """What becomes of the events of one filtered stream, which the server has described."""

    def __init__(self, link: Link, board: Board, stream: Mapping[str, Any], clocks: Clocks) -> None:
        self._link, self._board = link, board
        self._behind = clocks.behind(stream["name"], stream["kind"])
        self._name, self._kind = stream["name"], KINDS[stream["kind"]]
        self._within = stream["decide_within"] / 10**9
        self._policy: Policy = stream["on_unavailable"]
        if self._kind.passes_when_undecided:
            self._policy = "pass"

    def ask(self, stamp: Stamp, data: Any, then: Then, **more: Any) -> None:
        """Ask about an event; `then` and `more` are what `Link.ask_then` takes."""
        self._link.ask_then(
            self._name, self._kind.name, stamp, data, then, decide_within=self._within, **more
        )
        self._link.clock(self._behind)

    def settle(
        self,
        answer: Answer,
        give: Callable[[Any], bool],
        what: Any,
        call: Optional[int] = None,
        goal_id: str = "",
    ) -> Tuple[bool, str]:
        """Return whether it passed, and a text why not; report the handling to the server.

        What may pass is given to `give`, which returns whether it was passed on: an adapter that
        ends, or is replaced, forwards nothing more, and the history must not claim that it did. An
        exception of `give` is counted and shown: the event did not pass.
        """
        event = f"a {self._kind.event} of {self._name}"
        if goal_id:
            event += f", goal {goal_id}"
        elif self._kind.has_call:
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

    def take_back(self, answer: Answer) -> None:
        """Report that what `settle` let pass went no further after all: nobody was there for it."""
        self._link.handled(answer, False, should_pass(answer, self._policy)[1])

    def ask_and_wait(
        self,
        stamp: Stamp,
        data: Any,
        call: int,
        may_go_on: Callable[[], bool],
        lost: int = 0,
        before: Optional[Callable[[TakeBack], object]] = None,
    ) -> Tuple[bool, str]:
        """Ask about a call, and wait for what `settle` returns.

        What the oracle lets pass passes where it `may_go_on` then. Where the link's thread hangs,
        the wait ends `GRACE` seconds after the time for a decision; then the call does not pass,
        whatever the answer will be. `lost` is as for `Link.ask`. `before` is given what takes it
        back, before it passes.
        """
        settled: SimpleQueue[Tuple[bool, str]] = SimpleQueue()
        passed = threading.Lock()  # taken by what comes first: the answer, or the end of the wait

        def give(_: Any) -> bool:
            return may_go_on() and passed.acquire(blocking=False)

        def answered(answer: Answer) -> None:
            if before is not None:
                before(lambda: self.take_back(answer))
            settled.put(self.settle(answer, give, None, call))

        self.ask(stamp, data, answered, call=call, lost=lost)
        try:
            return settled.get(timeout=self._within + GRACE)
        except Empty:
            if passed.acquire(blocking=False):
                return False, "there is no answer from the link"
            return True, ""
