"""Explanations on request: computed one at a time, with a bounded queue; cancelled when the client disconnects."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine
from functools import partial
from typing import Any, TypeVar

from fastapi import HTTPException, Request

from oracle_server.api.leaving import unless_left
from oracle_server.core.records import VerdictRecord
from oracle_server.history.port import Reading
from oracle_server.history.views import View
from oracle_server.review.explanation import explained

MOST = 16
"""Requests that may be open at a time, including the one that is computed."""
_RETRY_AFTER = 5
"""Seconds after which a client that was refused should try again."""

T = TypeVar("T")
_Record = VerdictRecord | None


class Explainer:
    """Explains the verdicts of one history, one at a time."""

    def __init__(self, history: Reading) -> None:
        self._history = history
        self._computing = asyncio.Lock()
        self._open = 0

    async def explained(self, request: Request, session: int, n: int, view: View) -> _Record:
        """Verdict record `n` of a session (by its number) with its explanation; None where there is no such record.

        It is explained as it stands, or was said at first.

        Raises `NoExplanationError`, and 503 where `MOST` requests are open already.
        """
        return await self.in_turn(request, partial(explained, self._history, session, n, view))

    async def in_turn(self, request: Request, answer: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """What is computed as explanations are, in turn with them; 503 where `MOST` requests are open already."""
        if self._open >= MOST:
            detail = f"{MOST} explanations are being computed or waited for already; ask again later"
            raise HTTPException(503, detail, {"Retry-After": str(_RETRY_AFTER)})
        self._open += 1
        try:
            return await unless_left(request, self._next(answer))
        finally:
            self._open -= 1

    async def _next(self, answer: Callable[[], Coroutine[Any, Any, T]]) -> T:
        async with self._computing:
            return await answer()
