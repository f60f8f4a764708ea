"""Questions of clients, for the process that answers them: one after the other, of all clients in turns."""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import partial

import msgspec

from oracle_server.core.errors import HistoryError, UnpreparedError
from oracle_server.history.matching import Told
from oracle_server.history.query import Query
from oracle_server.history.readers import Readers
from oracle_server.history.records import SessionRecord
from oracle_server.history.sql import answering
from oracle_server.history.sql.answering import Answer, ByNumber, ByTime, Opening, Request
from oracle_server.history.sql.database import Database
from oracle_server.history.timeline import Question
from oracle_server.history.views import Doubts
from oracle_server.process.worker import Worker, WorkerError

_WITHIN = 30.0
"""Seconds for an answer, a hundred times what the longest one takes."""
_answer = msgspec.msgpack.Decoder(Answer).decode
_told = msgspec.msgpack.Decoder(Told).decode


class Asking:
    """Asks a process, which is started with the first question, and anew where it has ended."""

    def __init__(self, connect: Callable[[str], Database], target: str) -> None:
        """Ask about a database; `connect`, a function of a module, opens a connection to `target`."""
        self._opening = Opening(connect.__module__, connect.__name__, os.fsencode(target))
        self._threads = Readers(1, 1, "history asking")
        self.worker = Worker(answering.__name__)

    async def timeline(self, session: SessionRecord, question: Question) -> bytes:
        """What a session tells by time, as JSON. Raises `HistoryError`, or `UnpreparedError` until it is made."""
        return await self._threads.start(partial(self._ask, ByTime(session._replace(text=""), question)))

    async def told(self, session: SessionRecord, query: Query, position: int, doubts: Doubts | None) -> Told:
        """The verdict records that a query asks for, from a position on. Raises `HistoryError`."""
        request = ByNumber(session._replace(text=""), query, position, doubts)
        return await self._threads.start(lambda: _told(self._ask(request)))

    def close(self) -> None:
        """End the process."""
        self.worker.close()
        self._threads.close()

    def _ask(self, question: ByTime | ByNumber) -> bytes:
        try:
            answer = _answer(self.worker.ask(Request(self._opening, question), _WITHIN))
        except WorkerError as error:
            raise HistoryError(f"the history's reader gave no answer: {error}; ask again") from None
        if answer.error is not None:
            raise (UnpreparedError if answer.unprepared else HistoryError)(answer.error)
        return answer.body
