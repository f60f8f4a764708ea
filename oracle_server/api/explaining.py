"""Explanations on request: one is computed at a time, of one client after the other; cancelled when a client leaves.

How many may wait is bounded, for each client too, so that none keeps the others from theirs.
"""

from __future__ import annotations

import asyncio
from collections import Counter, deque
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager
from functools import partial
from typing import Any, TypeVar

from fastapi import HTTPException, Request

from oracle_server.api.leaving import unless_left
from oracle_server.core.records import VerdictRecord
from oracle_server.history.port import Reading
from oracle_server.history.readers import reader
from oracle_server.history.views import View
from oracle_server.review.explanation import explained

MOST = 32
"""Requests that may be open at a time, including the one that is computed."""
SHARE = 16
"""Of these at most of one client."""
_RETRY_AFTER = 5
"""Seconds after which a client that was refused should try again."""

T = TypeVar("T")
_Record = VerdictRecord | None


class Explainer:
    """Explains the verdicts of one history, one at a time."""

    def __init__(self, history: Reading) -> None:
        self._history = history
        self._turns = _Turns()
        self._open: Counter[str] = Counter()

    async def explained(self, request: Request, session: int, n: int, view: View) -> _Record:
        """Verdict record `n` of a session (by its number) with its explanation; None where there is no such record.

        It is explained as it stands, or was said at first.

        Raises `NoExplanationError`, and 503 where too many requests are open already.
        """
        return await self.in_turn(request, partial(explained, self._history, session, n, view))

    async def in_turn(self, request: Request, answer: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """What is computed as explanations are, in turn with them; 503 where too many requests are open already."""
        client = reader()
        if self._open[client] >= SHARE or self._open.total() >= MOST:
            whose = f"{SHARE} explanations for you" if self._open[client] >= SHARE else f"{MOST} explanations"
            detail = f"{whose} are being computed or waited for already; ask again later"
            raise HTTPException(503, detail, {"Retry-After": str(_RETRY_AFTER)})
        self._open[client] += 1
        try:
            return await unless_left(request, self._next(client, answer))
        finally:
            self._open[client] -= 1
            if not self._open[client]:
                del self._open[client]

    async def _next(self, client: str, answer: Callable[[], Coroutine[Any, Any, T]]) -> T:
        async with self._turns.of(client):
            return await answer()


class _Turns:
    """A turn for one at a time: of those that wait, one client has it after the other."""

    def __init__(self) -> None:
        self._taken = False
        self._waiting: dict[str, deque[asyncio.Future[None]]] = {}
        """By client, the one first whose turn is next."""

    @asynccontextmanager
    async def of(self, client: str) -> AsyncIterator[None]:
        """Wait for a turn of a client, and have it."""
        if self._taken:
            turn = asyncio.get_running_loop().create_future()
            self._waiting.setdefault(client, deque()).append(turn)
            try:
                await turn
            except asyncio.CancelledError:
                if not turn.cancelled():  # it had just come
                    self._pass_on()
                raise
        self._taken = True
        try:
            yield
        finally:
            self._pass_on()

    def _pass_on(self) -> None:
        while self._waiting:
            client = next(iter(self._waiting))
            turns = self._waiting.pop(client)
            turn = turns.popleft()
            if turns:
                self._waiting[client] = turns  # behind all others
            if not turn.done():  # else nobody waits for it any more
                turn.set_result(None)
                return
        self._taken = False
