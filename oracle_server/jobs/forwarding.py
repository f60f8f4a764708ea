"""Forwards a robot's history to the centre's: a process brings a chunk at a time, for as long as the server runs.

Nothing waits for it. Where the centre can't be reached, what is there stays here, and is brought once it can be.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import msgspec
import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.forwarding.messages import Ask, Told
from oracle_server.history.readers import Readers
from oracle_server.history.records import Forwarding as Stands
from oracle_server.history.records import Free
from oracle_server.process.worker import Worker, WorkerError

_WITHIN = 150.0
"""Seconds that a chunk may take: over a slow network, too."""
_ROWS = 8_000
_LEAST = 64
"""A chunk has so many rows at the most; after one that failed half as many, down to the least."""
_IDLE = 1.0
"""Seconds between two looks where all is brought."""
_RETRY, _LONGEST = 1.0, 30.0
"""Seconds until what failed is tried again: twice as many each time, up to the most."""
_MODULE = "oracle_server.history.forwarding.working"
"""What the process runs: not imported here, since it needs psycopg, and a server that forwards nothing does not."""
_told = msgspec.msgpack.Decoder(Told).decode

log = structlog.get_logger()


class Noted(Protocol):
    """What a history keeps of its forwarding."""

    path: str

    @property
    def failure(self) -> str | None:
        """Why nothing can be kept now; None where it can."""
        ...

    async def stands(self) -> Stands:
        """Which history this is, and how far the centre is known to be. Raises `HistoryError`."""
        ...

    async def note(self, seq: int, reached: dict[int, int]) -> None:
        """Keep how far the centre is; returns once it is committed."""
        ...

    async def begin_anew(self, *, known: bool) -> None:
        """Have all forwarded from the beginning; as the same history where the centre is `known` to have some."""
        ...

    async def behind(self) -> tuple[int, int | None]:
        """The rows that the centre lacks, and when the oldest step of them was judged (ns). Raises `HistoryError`."""
        ...

    async def free(self) -> Sequence[Free]:
        """What of each session the centre has. Raises `HistoryError`."""
        ...


@dataclass(slots=True)
class Progress:
    """How the forwarding goes: rows that this process has brought, and what is still to be brought.

    `oldest` is when the first step among that was judged (ns), `trouble` why nothing can be brought, None where it can.
    `lost` are steps that were deleted before.
    """

    origin: str
    rows: int = 0
    left: int | None = None
    oldest: int | None = None
    trouble: str | None = None
    lost: int = 0


class Forwarding:
    """Asks the process, in a thread."""

    def __init__(self, noted: Noted, url: str, origin: str) -> None:
        """Forward a history to the one at `url`, as that of `origin`."""
        self.progress = Progress(origin)
        self.noted, self._url = noted, url
        self._worker = Worker(_MODULE)
        self._threads = Readers(1, 1, "forwarding")
        self._rows, self._pause = _ROWS, _RETRY

    async def run(self) -> None:
        """Forward for ever; what fails is logged once, and tried again."""
        while True:
            try:
                pause = await self._turn()
            except (HistoryError, WorkerError) as error:
                pause = self._failed(str(error))
            except Exception:  # without this task, nothing would come to the centre, and nobody would know
                log.exception("the history can't be forwarded now")
                pause = self._failed("an error of the server; see its log")
            if self.progress.trouble is not None:
                with suppress(HistoryError):  # what was known last stands
                    self.progress.left, self.progress.oldest = await self.noted.behind()
            await asyncio.sleep(pause)

    def close(self) -> None:
        """End the process."""
        self._worker.close()
        self._threads.close()

    async def _turn(self) -> float:
        """Have a chunk brought; returns for how many seconds to rest.

        While nothing is kept here nothing is judged: the centre does not hear of it, and says so of what is open.
        """
        if (failure := self.noted.failure) is not None:
            raise HistoryError(f"the history here can't be written: {failure}")
        stands = await self.noted.stands()
        ask = Ask(os.fsencode(self.noted.path), self._url, self.progress.origin, stands.robot, stands.seq, self._rows)
        told = _told(await self._threads.start(partial(self._worker.ask, ask, _WITHIN)))
        if told.error is not None:
            return self._failed(told.error)
        if told.anew is not None:
            log.warning("the history is forwarded anew from the beginning", reason=_REASONS[told.anew])
            await self.noted.begin_anew(known=told.anew == "less")
            return 0.0
        self._succeeded(told)
        if told.rows or told.seq != stands.seq or told.reached:
            await self.noted.note(told.seq, told.reached)
        return 0.0 if told.left else _IDLE

    def _succeeded(self, told: Told) -> None:
        progress = self.progress
        if progress.left is None or progress.trouble is not None:
            log.info("the history is forwarded", origin=progress.origin, rows_left=told.left)
        if told.shared:
            log.warning(
                "another history was forwarded by this name within three minutes: two robots of one name can't be told "
                "apart; give each a name of its own (ORACLE_ORIGIN), unless this one's history was just replaced",
                origin=progress.origin,
            )
        progress.rows += told.rows
        progress.left, progress.oldest, progress.trouble = told.left, told.oldest, None
        progress.lost += told.lost
        if told.lost:
            log.error("the centre lacks steps that were deleted before they were forwarded", steps=told.lost)
        if told.dropped:
            log.warning("the centre has deleted sessions, and takes no more of them", steps=told.dropped)
        self._rows, self._pause = min(_ROWS, self._rows * 2), _RETRY

    def _failed(self, reason: str) -> float:
        if self.progress.trouble is None:
            log.warning("the history can't be forwarded now; it is kept here, and tried again", reason=reason)
        self.progress.trouble = reason
        self._rows, pause = max(_LEAST, self._rows // 2), self._pause
        self._pause = min(_LONGEST, pause * 2)
        return pause


_REASONS = {
    "less": "the centre has less of it than it had",
    "other": "the centre has more than this history, or another one of the same origin: one of them is a copy",
}
