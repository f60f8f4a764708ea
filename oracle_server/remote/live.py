"""The oracles elsewhere of one session: each is asked in its own task, and none is waited for by the event loop."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import NamedTuple

import structlog

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.events import Order
from oracle_server.core.session import Session
from oracle_server.core.verdicts import Judged, Outcome
from oracle_server.remote.oracle import ExternalOracle

_SETTLE_WITHIN = 5.0

log = structlog.get_logger()


class _Line(NamedTuple):
    """One property's oracle in one order, and the questions that wait for it, each with when it was put."""

    oracle: ExternalOracle
    questions: asyncio.Queue[tuple[Ask, float]]


class Oracles:
    """Asks what the core wants to know, and gives it the answers."""

    def __init__(self, core: Session, now: Callable[[], int], deliver: Callable[[list[Judged]], None]) -> None:
        """Ask for a session, from within the event loop; `deliver` is given what it judges by the answers."""
        self._core, self._now, self._deliver = core, now, deliver
        self._lines: dict[tuple[Order, int], _Line] = {}
        self._expected: dict[tuple[str, int], asyncio.Future[Judged]] = {}
        self._moved = asyncio.Event()
        for order in core.judges:
            for index in core.plan.external:
                asked = core.plan.spec.properties[index].external
                assert asked is not None  # noqa: S101 -- it is external
                self._lines[order, index] = _Line(ExternalOracle(asked), asyncio.Queue())
        loop = asyncio.get_running_loop()
        self._tasks = [loop.create_task(self._serve(line)) for line in self._lines.values()]

    def resume(self) -> None:
        """Go on with a session whose oracles were told of events before."""
        for line in self._lines.values():
            line.oracle.begun = True

    def ask(self) -> None:
        """Put the questions that the core has."""
        now = asyncio.get_running_loop().time()
        for ask in self._core.take_asks():
            self._lines[ask.order, ask.property].questions.put_nowait((ask, now))

    def judgement(self, monitor: str, seq: int) -> asyncio.Future[Judged] | None:
        """What will be said of an event that was taken just now, None where it does not wait for an oracle."""
        last = self._core.asking.last if self._core.asking else None
        if last is None or (last.event.monitor, last.event.seq) != (monitor, seq):
            return None
        return self._expected.setdefault((monitor, seq), asyncio.get_running_loop().create_future())

    async def settle(self) -> None:
        """Let what waits be judged, as unknown where no answer comes in time, and end."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_SETTLE_WITHIN):
                while self._core.asking:
                    self._moved.clear()
                    await self._moved.wait()
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        self._tell(self._core.abandon("had not answered when the session ended", self._now()))
        await asyncio.gather(*(line.oracle.close() for line in self._lines.values()))

    async def _serve(self, line: _Line) -> None:
        loop = asyncio.get_running_loop()
        await line.oracle.connect(loop.time() + line.oracle.timeout)
        while True:
            ask, since = await line.questions.get()
            answer = await self._answer(line.oracle, ask, since)
            try:
                self._tell(self._core.resolve(ask, answer, self._now()))
            except Exception:
                log.exception("an oracle's answer could not be taken in")

    async def _answer(self, oracle: ExternalOracle, ask: Ask, since: float) -> Answer:
        """What an oracle says; one that is behind is not asked, so that none is given too little time."""
        waited = asyncio.get_running_loop().time() - since
        if waited > oracle.timeout / 2:
            return Answer(Outcome.UNKNOWN, f"was not asked: it was {waited:.1f} s behind")
        return await oracle.ask(ask, since + oracle.timeout)

    def _tell(self, judged: list[Judged]) -> None:
        self._deliver(judged)
        for item in judged:
            expected = self._expected.pop((item.step.event.monitor, item.step.event.seq), None)
            if expected is not None and not expected.done():
                expected.set_result(item)
        self._moved.set()
