"""The external oracles of a live session: each is asked by a task of its own, so that none delays another."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.events import Order
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.remote.oracle import ExternalOracle

SETTLE_WITHIN = 5.0
"""Seconds to wait for the last answers when a session ends."""

Judging = Callable[[], list[Judged]]
"""What judges something, and returns the steps of it."""


class _Line(NamedTuple):
    """One property's oracle in one order, and its queue of questions, each with the time (s) of its queuing."""

    oracle: ExternalOracle
    questions: asyncio.Queue[tuple[Ask, float]]


class Oracles:
    """Sends a session's questions to its oracles, and the answers to the session."""

    def __init__(self, core: Session, now: Callable[[], int], judge: Callable[[Judging], object]) -> None:
        """Start a task for each oracle; `judge` has the session judge by the answers, and delivers what comes of it."""
        self._core, self._now, self._judge = core, now, judge
        self._lines: dict[tuple[Order, int], _Line] = {}
        self._progress = asyncio.Event()
        for order in core.judges:
            for index in core.plan.external:
                external = core.plan.spec.properties[index].external
                assert external is not None  # noqa: S101 -- the plan lists external properties
                self._lines[order, index] = _Line(ExternalOracle(external), asyncio.Queue())
        loop = asyncio.get_running_loop()
        self._tasks = [loop.create_task(self._serve(line)) for line in self._lines.values()]

    def resume(self) -> None:
        """Continue a restored session, whose oracles have received events before."""
        for line in self._lines.values():
            line.oracle.used = True

    def ask(self) -> None:
        """Queue the session's new questions."""
        now = asyncio.get_running_loop().time()
        for ask in self._core.take_asks():
            self._lines[ask.order, ask.property].questions.put_nowait((ask, now))

    def is_waited_for(self, monitor: str, seq: int) -> bool:
        """Whether the last event is this one, and waits for an oracle."""
        last = self._core.asking.last if self._core.asking else None
        return last is not None and (last.event.monitor, last.event.seq) == (monitor, seq)

    async def settle(self, within: float = SETTLE_WITHIN) -> None:
        """Wait so many seconds for the answers, then give up the missing ones, and close the connections."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                while self._core.asking:
                    self._progress.clear()
                    await self._progress.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tasks.clear()  # each holds its error, whose frames hold this
        reason = "had not answered when the session ended"
        self._go_on(lambda: self._core.abandon(reason, self._now()))
        await asyncio.gather(*(line.oracle.close() for line in self._lines.values()))

    async def _serve(self, line: _Line) -> None:
        loop = asyncio.get_running_loop()
        await line.oracle.connect(loop.time() + line.oracle.timeout)
        while True:
            ask, since = await line.questions.get()
            answer = await self._answer(line.oracle, ask, since)
            self._go_on(partial(self._core.resolve, ask, answer, self._now()))

    async def _answer(self, oracle: ExternalOracle, ask: Ask, since: float) -> Answer:
        """The answer to a question; it is not sent where it has waited too long to leave enough time for a reply."""
        waited = asyncio.get_running_loop().time() - since
        if waited > oracle.timeout / 2:
            return Answer(Outcome.UNKNOWN, f"was not asked: it was {waited:.1f} s behind")
        return await oracle.ask(ask, since + oracle.timeout)

    def _go_on(self, judging: Judging) -> None:
        self._judge(judging)
        self._progress.set()
