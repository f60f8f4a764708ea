"""A history in a file that is forwarded: what it keeps for that, and what it holds back from retention."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.history.forwarding import changes
from oracle_server.history.records import Forwarding, Free
from oracle_server.history.sql.batch import Work
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.reader import Reader
from oracle_server.history.sql.writer import Writer

_NOBODY = 0
"""The number of no session."""


class SqliteForwarding:
    """Notes for a history, by its writer, what the centre has."""

    def __init__(self, path: str, writer: Writer, reader: Reader) -> None:
        self.path = path
        self._writer, self._reader = writer, reader

    @property
    def failure(self) -> str | None:
        """Why nothing can be kept now; None where it can."""
        return self._writer.failure

    async def stands(self) -> Forwarding:
        """Which history this is, and how far the centre is known to be. Raises `HistoryError`."""
        return Forwarding(*await self._reader.row(changes.STANDS))

    async def note(self, seq: int, reached: Mapping[int, int]) -> None:
        """Keep how far the centre is: at a change, and at a position of some sessions. Returns once it is committed."""
        for each in reached.items():
            self._add(changes.REACHED, each)
        self._add(changes.ACKED, (seq,))
        self._add(changes.FORGET, (seq,))
        await self._writer.flush()

    async def begin_anew(self, *, known: bool) -> None:
        """Have all forwarded from the beginning; as the same history where the centre is `known` to have some of it."""
        for sql in changes.beginning_anew(known=known):
            self._add(sql, ())
        await self._writer.flush()

    async def free(self) -> list[Free]:
        """What of each session may be deleted, since the centre has it. Raises `HistoryError`."""

        def read(reader: Database) -> list[Free]:
            rows = reader.execute(changes.FREE).fetchall()
            return [
                Free(number, min(at for at in known if at is not None), bool(more)) for number, *known, more in rows
            ]

        return await self._reader.run(read)

    async def behind(self) -> tuple[int, int | None]:
        """The rows that the centre does not have, and when the oldest step of them was judged (ns).

        Raises `HistoryError`.
        """

        def read(reader: Database) -> tuple[int, int | None]:
            rows = reader.execute(changes.BEHIND).fetchall()
            (untold,) = reader.execute(changes.UNTOLD).fetchone()
            steps = sum(max(0, last - max(reached, first - 1)) for reached, first, last, _ in rows)
            return steps + untold, min((judged for *_, judged in rows if judged is not None), default=None)

        return await self._reader.run(read)

    def _add(self, sql: str, values: tuple[Any, ...]) -> None:
        self._writer.add(Work(_NOBODY, sql, values, needed=False, always=True))
