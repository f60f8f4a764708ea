"""Explanations on request: one is computed at a time, a few wait, and one that nobody waits for is given up."""

from __future__ import annotations

import asyncio

from fastapi import HTTPException, Request

from oracle_server.core.records import VerdictRecord
from oracle_server.history.port import Reading
from oracle_server.review.explanation import explained

MOST = 16
"""Explanations that may be waited for at a time, the one that is computed included."""
_LOOK_EVERY = 0.25
"""Seconds between two looks whether the client is still there."""
_AGAIN_AFTER = 5
"""Seconds after which a client that was refused may ask again."""

_Record = VerdictRecord | None


class Explainer:
    """Explains the verdicts of one history."""

    def __init__(self, history: Reading) -> None:
        self._history = history
        self._turn = asyncio.Lock()
        self._asked = 0

    async def explained(self, request: Request, session: int, n: int) -> _Record:
        """Record number `n` of a session, by its number, with its explanation; None where there is no such record.

        Raises `NoExplanationError`, and 503 where too many explanations are waited for already.
        """
        if self._asked >= MOST:
            detail = f"{MOST} explanations are being computed or waited for already; ask again later"
            raise HTTPException(503, detail, {"Retry-After": str(_AGAIN_AFTER)})
        computing = asyncio.create_task(self._in_turn(session, n))
        self._asked += 1
        computing.add_done_callback(self._answered)
        try:
            while not (await asyncio.wait((computing,), timeout=_LOOK_EVERY))[0]:
                if await request.is_disconnected():
                    raise HTTPException(400, "the client left before its answer")
            return computing.result()
        finally:
            computing.cancel()

    async def _in_turn(self, session: int, n: int) -> _Record:
        async with self._turn:
            return await explained(self._history, session, n)

    def _answered(self, computing: asyncio.Task[_Record]) -> None:
        self._asked -= 1
        if not computing.cancelled():
            computing.exception()  # it has been seen: who waited for it has got it, or has left
