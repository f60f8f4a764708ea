"""What is judged of events that somebody waits for: all that is said of one, however late, and of all its rows."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from oracle_server.core.verdicts import Judged


class Judgement:
    """What is judged of an event."""

    def __init__(self) -> None:
        self.steps: list[Judged] = []
        self._whole = asyncio.Event()

    @property
    def is_cut(self) -> bool:
        """Whether rows of it are judged, and others are not yet."""
        return bool(self.steps) and self.steps[-1].step.event.more

    def add(self, item: Judged) -> None:
        """Take a step of it."""
        self.steps.append(item)
        if not item.step.event.more:
            self._whole.set()

    async def whole(self) -> list[Judged]:
        """The steps of it, once the last one is judged."""
        await self._whole.wait()
        return self.steps


class Judgements:
    """Gathers what is judged of the events that are waited for."""

    def __init__(self) -> None:
        self._awaited: dict[tuple[str, int], Judgement] = {}

    @contextmanager
    def of(self, monitor: str, seq: int) -> Iterator[Judgement]:
        """What is judged from now on of a monitor's event, by its number."""
        found = self._awaited[monitor, seq] = Judgement()
        try:
            yield found
        finally:
            del self._awaited[monitor, seq]

    def note(self, judged: Sequence[Judged]) -> None:
        """Take what was judged."""
        for item in judged if self._awaited else ():
            wanted = self._awaited.get((item.step.event.monitor, item.step.event.seq))
            if wanted is not None:
                wanted.add(item)
