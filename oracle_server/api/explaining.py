"""Explanations on request: one is computed at a time, a few wait, and one that nobody waits for is given up."""

from __future__ import annotations

import asyncio
import threading
from typing import Any

from fastapi import HTTPException, Request

from oracle_server.history.sqlite.store import Store
from oracle_server.review.explanation import explained

MOST = 16
"""Explanations that may be waited for at a time, the one that is computed included."""
_LOOK_EVERY = 0.25
"""Seconds between two looks whether the client is still there."""
_AGAIN_AFTER = 5
"""Seconds after which a client that was refused may ask again."""

_Record = dict[str, Any] | None


class Explainer:
    """Explains the verdicts of one history."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._turn = asyncio.Lock()
        self._asked = 0

    async def explained(self, request: Request, session: int, n: int) -> _Record:
        """Record number `n` of a session, by its number, with its explanation; None where there is no such record.

        Raises `NoExplanationError`, and 503 where too many explanations are waited for already.
        """
        if self._asked >= MOST:
            detail = f"{MOST} explanations are being computed or waited for already; ask again later"
            raise HTTPException(503, detail, {"Retry-After": str(_AGAIN_AFTER)})
        given_up = threading.Event()
        computing = asyncio.create_task(self._in_turn(session, n, given_up))
        self._asked += 1
        computing.add_done_callback(self._answered)
        try:
            while not (await asyncio.wait((computing,), timeout=_LOOK_EVERY))[0]:
                if await request.is_disconnected():
                    raise HTTPException(400, "the client left before its answer")
            return computing.result()
        finally:
            given_up.set()
            computing.cancel()

    async def _in_turn(self, session: int, n: int, given_up: threading.Event) -> _Record:
        """The turn ends with the thread, so that there is never more than one."""
        async with self._turn:
            thread = asyncio.create_task(asyncio.to_thread(explained, self._store, session, n, given_up.is_set))
            try:
                return await asyncio.shield(thread)
            finally:
                await asyncio.wait((thread,))

    def _answered(self, computing: asyncio.Task[_Record]) -> None:
        self._asked -= 1
        if not computing.cancelled():
            computing.exception()  # it has been seen: who waited for it has got it, or has left
