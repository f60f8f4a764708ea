"""The history in PostgreSQL."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Collection, Sequence
from functools import partial
from typing import Any

import msgspec
import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.origins import (
    behind_text,
    copied_text,
    deleted_text,
    forwarded_name,
    missing_text,
    origin_of,
    silent_text,
)
from oracle_server.history.port import Done
from oracle_server.history.postgres import sharing
from oracle_server.history.postgres.leases import Unrenewed
from oracle_server.history.postgres.reader import Pool, PostgresReader, connect
from oracle_server.history.postgres.store import END_WRITER, Node, PostgresStore, writer
from oracle_server.history.readers import THREADS, Readers
from oracle_server.history.records import Document, Elsewhere, OtherSession, SessionRecord
from oracle_server.history.sql.asking import Asking
from oracle_server.history.sql.batch import Work
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.history import LOOKUPS, SqlHistory
from oracle_server.history.sql.rows import Row, session_of
from oracle_server.history.sql.schema import SESSION_COLUMNS
from oracle_server.history.sql.standing import stands
from oracle_server.history.sql.troubles import noted
from oracle_server.process.settings import LONGEST_LEASE

LEASE = 3.0
"""Seconds for which a server is a node of its database without saying so again."""
ALONE = Node("server")
"""The name of a server that has its database for itself."""
_SHARED_WITHIN = 6.0
"""Seconds for a number or sessions to be got: who waits for one gives up a little later."""
_SILENT = 180.0
"""Seconds for which nothing is heard of a robot before its monitors do not count as there."""
_TRIES = 100
"""Numbers that may have been given already by who did not ask for one."""
_MOST = 0.9
"""Of a lease: for so long nobody must have seen another node renew its own. There are ten looks in one."""
_RELEASED = "-infinity"
"""Until when a node has a lease that gave its sessions away."""
_NOBODY = 0
"""The number of no session."""

_decode = msgspec.json.decode

log = structlog.get_logger()


class PostgresHistory(SqlHistory):
    """A `History` in a database, which several servers may use: each is a node of it, and has sessions of its own."""

    _forgetting = sharing.FORGET_SESSION

    def __init__(
        self, url: str, lease: float = LEASE, end: Callable[[], object] = lambda: None, node: Node = ALONE
    ) -> None:
        """Become a node of a database, as `postgresql://…`; `end` is called where another one has taken over.

        Raises `HistoryError` where it can't be used, or another process is this node.
        """
        self.store = PostgresStore(url, lease, end, node)
        self._node = node.name
        self._others = False
        self._unrenewed, self._unseen = Unrenewed(), lease * _MOST
        self._pool = Pool(url, THREADS + LOOKUPS)

        def reader(threads: Readers, sorting: Readers) -> PostgresReader:
            return PostgresReader(self._pool, threads, sorting)

        super().__init__(self.store, reader, Asking(connect, url))

    def close(self) -> None:
        """Commit what waits, and let other servers have the sessions. Call it off the event loop."""
        super().close()
        self._pool.close()

    # commands

    def open_session(self, session: SessionRecord) -> None:
        """Keep a new session, as this node's."""
        self._execute(session.number, sharing.OWN, lambda: (session.number, session.id, self._node))
        super().open_session(session)

    def close_session(self, session: int, at: int, state: Document, done: Done | None = None) -> None:
        """Keep that a session was closed: it is no node's any more."""
        super().close_session(session, at, state, done)
        self._execute(session, sharing.DISOWN, lambda: (session,), needed=False, always=True)

    # sharing

    @property
    def others(self) -> bool:
        """Whether other servers were there lately."""
        return self._others

    @property
    def adrift(self) -> bool:
        """Whether another server may have this one's sessions by now."""
        return self.store.fenced is not None or (self._others and self.store.overdue is not None)

    @property
    def fenced(self) -> str | None:
        """Why nothing more can be kept by this server, ever."""
        return self.store.fenced

    async def reserve(self, name: str, number: int) -> int | None:  # noqa: ARG002 -- the database numbers them
        """Take a name for a new session; returns its number, None where another server has taken the name."""
        try:
            async with asyncio.timeout(_SHARED_WITHIN):
                for _ in range(_TRIES):
                    await self._share(sharing.RESERVE, name, self._node)
                    found = await self._lookups.one(tuple, sharing.RESERVED, (name,))
                    if found is not None and found[1] != self._node:
                        return None
                    if found is not None and not (found[2] or found[3]):
                        return int(found[0])
                    if found is not None:  # it was closed meanwhile, or somebody numbered a session by himself
                        await self._share(sharing.UNRESERVE, found[0], self._node, found[0])
                        if found[2]:
                            return None
        except TimeoutError:
            pass
        raise HistoryError("the database gives no number for a new session at the moment")

    async def open_sessions(self) -> list[SessionRecord]:
        """The sessions of this node that are not closed."""
        return await self._reader.sound(session_of, sharing.OWN_OPEN, (self._node,))

    async def elsewhere(self, name: str) -> Elsewhere | None:
        """Which node has a session that is open, by its id; None where it is closed or unknown."""
        if (origin := origin_of(name)) is not None:
            found = await self._lookups.one(tuple, sharing.FORWARDED_OPEN, (name,))
            return None if found is None else Elsewhere(origin, None, here=False, lasting=True, own=found[0])
        return await self._lookups.one(self._place, sharing.WHERE_IS, (name,))

    async def open_elsewhere(self, name: str | None = None, origin: str | None = None) -> list[OtherSession]:
        """The sessions that other nodes have open, or a robot's, the newest first; or the open one of a name."""
        end = None if origin is None else forwarded_name("", origin)
        found = await self._reader.all(self._other, sharing.OTHERS_OPEN, (self._node, name, end))
        numbers = ",".join(str(other.record.number) for other in found if origin_of(other.record.id))
        rows = await self._reader.all(tuple, sharing.FORWARDED, (_SILENT, f"{{{numbers}}}")) if numbers else []
        robots = {session: told for session, *told in rows}
        return [_of_robot(other, robots.get(other.record.number)) for other in found]

    async def missing(self, session: SessionRecord) -> Sequence[tuple[int, int]]:
        """The first and last positions of the steps that a robot had deleted before it brought them."""
        if origin_of(session.id) is None:
            return ()
        rows = await self._reader.all(tuple, sharing.MISSING, (session.number,))
        return [(first, last) for (gaps,) in rows for first, last in _decode(gaps)]

    async def left(self) -> list[str]:
        """The names of open sessions that robots have deleted."""
        return await self._reader.all(lambda row: str(row[0]), sharing.LEFT)

    async def take_over(self, known: Collection[int]) -> list[SessionRecord]:
        """Take the sessions of nodes whose lease has run out; returns those that are this one's, and not `known`."""
        nodes = await self._lookups.all(tuple, sharing.NODES, (self._node,))
        gone, others = [], False
        for node, owner, over, has_some, until in nodes:
            seconds = self._unrenewed.seconds(node, (owner, until))
            is_left = not over and seconds > LONGEST_LEASE
            others = others or not (over or is_left)
            if is_left or (over and has_some and (seconds >= self._unseen or until == _RELEASED)):
                gone.append((node, owner, until if is_left else None))
        self._others = others
        for node, owner, until in gone if self.store.steady else ():
            log.warning("another server's lease has run out: its sessions are taken over", node=node)
            await self._lookups.run(partial(_end_writer, name=writer(owner)))
            try:
                async with asyncio.timeout(_SHARED_WITHIN):
                    await self._share(sharing.TAKE_OVER, self._node, node, until)
            except TimeoutError:  # who waited on would not see that its own lease runs out
                raise HistoryError("the database does not say whether the sessions are taken over") from None
        return [session for session in await self.open_sessions() if session.number not in known]

    async def tended(self) -> frozenset[int] | None:
        """The sessions of which this node may delete."""
        return frozenset(await self._reader.all(lambda row: int(row[0]), sharing.TENDED, (self._node,)))

    async def _share(self, sql: str, *values: object) -> None:
        """Change who has what, in a transaction of this node as all that it writes."""
        done = asyncio.Event()
        self._writer.add(Work(_NOBODY, sql, values, done.set, needed=False, always=True))
        await done.wait()

    def _other(self, row: Row) -> OtherSession:
        record, place = session_of(row[: len(SESSION_COLUMNS)]), self._place(row[-10:-7])
        steps, outcomes, degraded, pending, told, them, state = row[-7:]
        properties = stands(record.properties, outcomes, degraded, pending, told) if outcomes else []
        monitors = [tuple(one) for one in _decode(them or "[]")]
        return OtherSession(record, place, steps, properties, monitors, unjudged=noted(state))

    def _place(self, row: Row) -> Elsewhere:
        node, url, lasting = row
        return Elsewhere(node or "", url, node == self._node, lasting)


def _of_robot(other: OtherSession, told: list[Any] | None) -> OtherSession:
    """A session with its place at the robot that forwards it, if one does.

    What is `told`: which steps are missing, whether the robot has deleted it, since when that is not heard, and what it
    has still to bring; None where it forwards elsewhere.
    """
    origin = origin_of(other.record.id)
    if origin is None:
        return other
    if told is None:
        place = Elsewhere(origin, None, here=False, lasting=False)
        return other._replace(place=place, trouble=copied_text(origin), may_end=True)
    gaps, deleted, silent, behind = told
    troubles = [missing_text(missing)] if (missing := _decode(gaps)) else []
    troubles += [deleted_text(origin)] if deleted else [silent_text(origin, silent)] if silent else []
    may_end = deleted or silent is not None
    if behind is not None and not may_end:
        troubles.append(behind_text(origin, *_decode(behind)[1:]))
    place = Elsewhere(origin, None, here=False, lasting=not may_end and behind is None)
    return other._replace(place=place, trouble="; ".join(troubles) or None, may_end=may_end)


def _end_writer(database: Database, name: str) -> None:
    database.execute(END_WRITER, (name,)).fetchall()
