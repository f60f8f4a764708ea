"""The connection that alone writes for a server: each transaction shows that this is still a node of the database."""

from __future__ import annotations

import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.postgres.connection import Connection
from oracle_server.history.postgres.leases import Unrenewed
from oracle_server.history.postgres.schema import prepare
from oracle_server.history.sql.rows import Row
from oracle_server.process.settings import LONGEST_LEASE

T = TypeVar("T")
PATIENCE = 10.0
"""Seconds for an answer; after them the connection is taken to be dead, and another one made."""
_POLL = 0.1
"""Seconds between two looks at whether another process's lease has run out."""
_GRACE = 0.5
"""Seconds for which a lease that has run out is waited for to be renewed: this process may just have stood still."""

_CLAIM = """
INSERT INTO nodes (node, owner, epoch, until, batch, place, url)
VALUES (?1, ?2, 1, clock_timestamp() + ?3 * interval '1 second', 0, ?4, ?5)
ON CONFLICT (node) DO UPDATE SET owner = excluded.owner, epoch = nodes.epoch + 1, until = excluded.until,
    place = excluded.place, url = excluded.url
WHERE nodes.until <= clock_timestamp() OR nodes.until::text = ?6::text
RETURNING epoch, batch
"""
"""Become a node, where no other process is it, or has a lease that it has not renewed for too long."""
_CLAIM_AGAIN = """
UPDATE nodes SET epoch = epoch + 1, until = clock_timestamp() + ? * interval '1 second'
WHERE node = ? AND owner = ?
RETURNING epoch, batch
"""
"""Go on by another connection, unless another node has taken over: then there is no such owner."""
_HOLD = """
UPDATE nodes SET until = clock_timestamp() + ? * interval '1 second', batch = ?
WHERE node = ? AND owner = ? AND epoch = ? AND batch = ?
"""
_OWNS = "SELECT 1 FROM nodes WHERE node = ? AND owner = ?"
_FORGET = """
DELETE FROM nodes
WHERE until < clock_timestamp() - interval '1 day' AND NOT EXISTS (SELECT 1 FROM owners WHERE owners.node = nodes.node)
"""
"""Nodes that will not come back; what stood still for so long finds no row, and ends."""
_RELEASE = "UPDATE nodes SET until = '-infinity' WHERE node = ? AND owner = ? AND epoch = ?"
_HOLDER = (
    "SELECT owner, epoch, until::text, place, until <= clock_timestamp(), "
    "until > clock_timestamp() + ? * interval '1 second' FROM nodes WHERE node = ?"
)
_TAKEN_OVER = "another server has taken over this server's sessions; this one ends"
_LOST = (
    "PostgreSQL has not any more what this server had committed, as where a standby takes over that lagged, or a "
    "backup was put back; this one ends, since its sessions can only go on with what is there"
)
"""Else steps would follow behind a gap, and violations in it be forgotten without a word."""
END_WRITER = """
SELECT pg_terminate_backend(pid) FROM pg_stat_activity
WHERE application_name = ? AND datname = current_database() AND pid <> pg_backend_pid()
"""
"""A backend whose client is gone, or stands still, keeps the row of the lease locked otherwise."""

log = structlog.get_logger()


class Node(NamedTuple):
    """A server among those that share a database: its name, and where monitors reach it, if that is known."""

    name: str
    url: str | None = None


class FencedError(HistoryError):
    """Another server has taken over this one's sessions, or what it has of them is not what is kept."""


class _Doubt(NamedTuple):
    """A transaction of which it is not known whether it is committed: its number, and what its work gave."""

    batch: int
    result: Any


class PostgresStore:
    """A node of a database, which this server is for as long as it says so again within `lease` seconds."""

    def __init__(self, url: str, lease: float, end: Callable[[], object], node: Node) -> None:
        """Become a node; `end` is called where another one has taken over what this one had.

        Raises `HistoryError` where the database can't be used, or another process is this node.
        """
        self._url, self._lease, self._end, self._node = url, lease, end, node
        self._owner = secrets.token_hex(8)
        self._place = f"{socket.gethostname()}, process {os.getpid()}"
        self._database: Connection | None = None
        self._epoch = self._batch = 0
        self._doubt: _Doubt | None = None
        self._held = self._tried = time.monotonic()
        self._steady = self._held - lease
        self._news = threading.Condition()
        self._failing = False
        self._hopes = True
        """Whether to wait for news: since it was last waited for in vain the lease was renewed in time."""
        self.fenced: str | None = None
        """Why this server is no node any more."""
        database = self._connected()
        try:
            self.where = f"database {database.raw.info.dbname} at {database.raw.info.host or 'the local socket'}"
            prepare(database)
            self._take(database)
        except BaseException:
            database.close()
            raise
        self._database = database

    @property
    def renewal(self) -> float:
        """Seconds until it wants to be renewed: a third of a lease after the last try began, however long that took."""
        return max(0.0, self._tried + self._lease / 3 - time.monotonic())

    @property
    def overdue(self) -> str | None:
        """Why nothing may be decided: another server may have the database by now.

        Where that is noticed first, it is waited for `_GRACE` seconds at the most, in whichever thread that is: where
        this process stood still, PostgreSQL was not silent, and says at once who has the database.
        """
        if self._silence > self._lease:
            self._await_news()
        silent = self._silence
        if self.fenced is not None or silent <= self._lease:
            return self.fenced
        return f"PostgreSQL has not answered for {silent:.0f} s"

    @property
    def steady(self) -> bool:
        """Whether it has held its lease for as long as one lasts.

        Else it was PostgreSQL that was gone, or this server that stood still: others have had no time to renew theirs.
        """
        return self.overdue is None and time.monotonic() - self._steady >= self._lease

    def insert(self, database: Connection, table: str, rows: list[Row]) -> None:
        """Insert rows into a table."""
        database.insert(table, rows)

    def transact(self, work: Callable[[Connection], T]) -> T:
        """Do work in a transaction, and return what it gives once that is committed."""
        with self._trying():
            return self._transacted(work)

    def renew(self) -> None:
        """Show that this server is there. Raises `HistoryError`."""
        with self._trying():
            database = self._again()
            try:
                self._hold(database, self._batch)
            except BaseException:
                if database.lost:
                    self._drop(database)
                raise

    def reason(self, error: Exception) -> str:
        """What people are told of an error."""
        return str(error)

    def close(self) -> None:
        """Be no node any more: other ones may have the sessions."""
        if self._database is not None:
            try:
                self._database.execute(_RELEASE, (self._node.name, self._owner, self._epoch))
            except (HistoryError, ValueError):
                log.warning("the lease is not given back; other servers go on with the sessions a little later")
            self._database.close()

    def _transacted(self, work: Callable[[Connection], T]) -> T:
        database = self._again()
        if self._doubt is not None:
            doubt, self._doubt = self._doubt, None
            if doubt.batch == self._batch:
                result: T = doubt.result
                return result
        batch = self._batch + 1
        database.execute("BEGIN")
        try:
            self._hold(database, batch)
            result = work(database)
            self._doubt = _Doubt(batch, result)
            database.commit()
        except BaseException:
            if not database.lost:
                database.rollback()
            if database.lost:
                self._drop(database)
            else:  # the server has said that it is not committed
                self._doubt = None
            raise
        self._doubt, self._batch = None, batch
        return result

    @property
    def _silence(self) -> float:
        return time.monotonic() - self._held

    def _await_news(self) -> None:
        """Wait until the lease is renewed or that has failed; but once where PostgreSQL says so too late each time."""
        with self._news:
            if self._hopes:
                self._hopes = self._news.wait_for(lambda: self._failing or self._silence <= self._lease, _GRACE)

    @contextmanager
    def _trying(self) -> Iterator[None]:
        """Note how what shows that this is a node ends; what is committed shows it for when that began."""
        self._tried = begun = time.monotonic()
        failing = self._failing
        try:
            yield
            if begun - self._held > self._lease:
                self._steady = begun
            self._held, failing = begun, False
        except HistoryError:
            failing = True
            raise
        finally:
            with self._news:
                self._failing = failing
                self._hopes = self._hopes or self._silence <= self._lease
                self._news.notify_all()

    def _connected(self) -> Connection:
        return Connection(self._url, writer(self._owner), PATIENCE)

    def _again(self) -> Connection:
        """The connection; a new one where that is lost, by which no other can write any more."""
        if self.fenced is not None:
            raise FencedError(self.fenced)
        if self._database is not None:
            if not self._database.ended:
                return self._database
            self._drop(self._database)
        database = self._connected()
        try:
            database.execute(END_WRITER, (writer(self._owner),))
            # it waits for what another connection of this server has begun: then it is known what was committed
            database.execute("BEGIN")
            again = database.execute(_CLAIM_AGAIN, (self._lease, self._node.name, self._owner)).fetchone()
            database.commit()  # behind that, on a standby too
            epoch, batch = again or self._fence(_TAKEN_OVER)
            if batch < self._batch:
                self._fence(_LOST)
            self._epoch, self._batch = epoch, batch
        except BaseException:
            database.close()
            raise
        self._database = database
        return database

    def _drop(self, database: Connection) -> None:
        self._database = None
        database.close()

    def _hold(self, database: Connection, batch: int) -> None:
        values = (self._lease, batch, self._node.name, self._owner, self._epoch, self._batch)
        held: Any = database.execute(_HOLD, values)
        if held.rowcount != 1:
            owns = database.execute(_OWNS, (self._node.name, self._owner)).fetchone()
            self._fence(_LOST if owns else _TAKEN_OVER)

    def _fence(self, why: str) -> Any:
        self.fenced = why
        self._end()
        raise FencedError(self.fenced)

    def _take(self, database: Connection) -> None:
        """Become the node, once the process that was it is known to have ended. Raises `HistoryError`."""
        name, url = self._node
        database.execute(_FORGET)
        known = holder = self._holder(database)
        renewals, unrenewed = 0, Unrenewed()
        if holder is not None and holder[-1]:
            log.warning(
                f"the last server's lease is longer than any lasts: PostgreSQL's clock was set back; it counts no more "
                f"once nobody has renewed it for {LONGEST_LEASE:.0f} s",
                node=name, until=holder[2],
            )  # fmt: skip
        while holder is not None and not (holder[-2] or unrenewed.ended(name, holder[:3])):
            if holder[:3] != known[:3]:
                known, renewals = holder, renewals + 1
            if renewals > 1:  # one may be of a server that was killed: what it had begun is committed behind it
                raise HistoryError(
                    f"another server is the node '{name}' of this database ({holder[3]}): stop it, or name this one "
                    "by ORACLE_NODE"
                )
            time.sleep(_POLL)
            holder = self._holder(database)
        if holder is not None:
            database.execute(END_WRITER, (writer(holder[0]),))
        values = (name, self._owner, self._lease, self._place, url, holder and holder[2])
        found = database.execute(_CLAIM, values).fetchone()
        if found is None:
            raise HistoryError(f"another server has become the node '{name}' of this database; name this one otherwise")
        self._epoch, self._batch = found
        self._held = time.monotonic()

    def _holder(self, database: Connection) -> Any:
        return database.execute(_HOLDER, (LONGEST_LEASE, self._node.name)).fetchone()


def writer(owner: str) -> str:
    """What the writing connection of a process is called among the database's activities."""
    return f"oracle-server writer {owner}"
