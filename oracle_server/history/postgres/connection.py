"""Connections to PostgreSQL, which take statements as SQLite has them."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import psycopg
from psycopg.abc import Buffer
from psycopg.adapt import Dumper
from psycopg.conninfo import conninfo_to_dict
from psycopg.types.string import StrDumperUnknown, TextLoader

from oracle_server.core.errors import HistoryError, UnansweredError
from oracle_server.history.postgres.dialect import decoded, encoded, translated, values_of
from oracle_server.history.postgres.watch import Watch
from oracle_server.history.sql.batch import COLUMNS
from oracle_server.history.sql.database import Cursor
from oracle_server.history.sql.rows import Row

T = TypeVar("T")
_CONNECT_WITHIN = 5
"""Seconds for a connection to be made."""
_SESSION = (
    "-c client_encoding=UTF8 -c standard_conforming_strings=on -c client_connection_check_interval=1000 "
    "-c tcp_keepalives_idle=5 -c tcp_keepalives_interval=2 -c tcp_keepalives_count=3 -c client_min_messages=warning "
    r"-c default_transaction_isolation=read\ committed -c DateStyle=ISO"
)
"""Whatever a role or the database has set.

A backend whose client is gone ends what it does within a second, and where the network is gone in some ten. Its
warnings are told: `commit` goes by them. Who has waited for a lock sees what was committed meanwhile. Times are written
as psycopg reads them.
"""
_OF_THE_NETWORK: dict[str, Any] = {
    "connect_timeout": _CONNECT_WITHIN, "keepalives": 1, "keepalives_idle": 5, "keepalives_interval": 2,
    "keepalives_count": 3, "tcp_user_timeout": 10_000, "target_session_attrs": "primary",
}  # fmt: skip
"""Of several hosts that which is no standby: such a one may lack what was committed, and nobody would see that."""
UNFIT = (psycopg.DataError, psycopg.IntegrityError, psycopg.errors.ProgramLimitExceeded)
"""What is raised for a value that can't be kept, now or ever."""


_watch = Watch()


class _Text(StrDumperUnknown):
    def dump(self, obj: str) -> Buffer | None:
        return super().dump(encoded(obj))


class _Bool(Dumper):
    """A truth value for a column of numbers or of truth values."""

    def dump(self, obj: bool) -> Buffer:
        return b"1" if obj else b"0"


class _Loaded(TextLoader):
    def load(self, data: Buffer) -> str:
        return decoded(str(super().load(data)))


class Connection:
    """One connection. What it raises is a `HistoryError`, or a `ValueError` for a value that can't be kept."""

    def __init__(self, url: str, name: str, patience: float) -> None:
        """Connect, as `name` among the server's activities; end what takes longer than `patience` seconds.

        Raises `HistoryError`.
        """
        self._patience, self._since = patience, 0.0
        self._severing, self._severed = threading.Lock(), False
        given = _read(url)
        options = f"{given.get('options') or os.environ.get('PGOPTIONS') or ''} {_SESSION}".strip()
        with _told():
            raw = psycopg.connect(
                **(_OF_THE_NETWORK | dict(given) | {"application_name": name, "options": options}),
                autocommit=True,
                cursor_factory=psycopg.RawCursor,
            )
        raw.adapters.register_dumper(str, _Text)
        raw.adapters.register_dumper(bool, _Bool)
        raw.adapters.register_loader("text", _Loaded)
        self.raw = raw
        self._warnings = warnings = list[str]()
        raw.add_notice_handler(lambda told: _note(told, warnings))
        _watch.add(self)

    @property
    def lost(self) -> bool:
        """Whether nothing more may be done with it: it has ended, or it is not known what it does."""
        return self._severed or self.raw.closed or self.raw.broken

    @property
    def ended(self) -> bool:
        """Whether it is lost, or the server has ended it while nobody used it: it says nothing else unasked."""
        if self.lost:
            return True
        told = select.poll()
        told.register(self.raw.pgconn.socket, select.POLLIN)
        return bool(told.poll(0))

    def execute(self, sql: str, values: Sequence[Any] = (), /) -> Cursor:
        """Execute a statement."""
        return self._timed(lambda: self.raw.execute(translated(sql).encode(), values_of(sql, values) or None))

    def executemany(self, sql: str, rows: Iterable[Sequence[Any]], /) -> None:
        """Execute a statement once for the values of each row."""
        made = [values_of(sql, row) for row in rows]
        if made:
            self._timed(lambda: self.raw.cursor().executemany(translated(sql).encode(), made))

    def insert(self, table: str, rows: list[Row], columns: Sequence[str] = ()) -> None:
        """Insert rows into a table, all of its columns in the history's order or those that are named."""
        names = ",".join(columns or COLUMNS[table])

        def insert() -> None:
            with self.raw.cursor().copy(f"COPY {table} ({names}) FROM STDIN".encode()) as copy:
                for row in rows:
                    copy.write_row(row)
                    self._since = _watch.now()  # many rows may take long; it is silence that is too long

        if rows:
            self._timed(insert)

    def commit(self) -> None:
        """Commit. Raises `HistoryError`, also where the transaction had failed already: its end is none then.

        One that an administrator cancels while it waits for a standby is told as done, with a warning: that is no
        answer.
        """
        self._warnings.clear()
        tag = self._timed(lambda: self.raw.execute(b"COMMIT").statusmessage)
        if self._warnings:
            self._severed = True
            raise UnansweredError(f"PostgreSQL: {self._warnings[0]}")
        if tag != "COMMIT":
            raise HistoryError("the history's transaction had failed, and is not committed")

    def rollback(self) -> None:
        """Give the transaction up, as far as there is one; where it can't be told, the connection is lost."""
        try:
            self._timed(lambda: self.raw.execute(b"ROLLBACK"))
        except (HistoryError, ValueError):
            self._severed = True

    def interrupt(self) -> None:
        """End what another thread does with it, and the connection with it."""
        with self._severing, contextlib.suppress(OSError, psycopg.Error):
            if self.raw.closed:
                return
            self._severed = True
            with socket.socket(fileno=os.dup(self.raw.pgconn.socket)) as end:
                end.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Let go of it."""
        with self._severing:
            self.raw.close()

    def sever_if_silent(self) -> None:
        """End it where it has waited for an answer for too long."""
        since = self._since  # read once: the work may end meanwhile
        if since and _watch.now() - since > self._patience:
            self.interrupt()

    def _timed(self, work: Callable[[], T]) -> T:
        self._since = _watch.now()
        try:
            with _told():
                return work()
        except UnansweredError:
            self._severed = True  # libpq may be in the midst of a pipeline, which nothing ends
            raise
        finally:
            self._since = 0.0


def _read(url: str) -> Mapping[str, Any]:
    """What a URL says. Raises `HistoryError`, without what libpq quotes of it: that may be the password."""
    try:
        return conninfo_to_dict(url)
    except psycopg.Error as error:
        what = _line(error).partition('"')[0].rstrip(" :")
        raise HistoryError(
            f"the URL of PostgreSQL can't be read: {what}; in names and passwords special characters are written "
            "percent-encoded, `%` as `%25`"
        ) from None


def _note(told: psycopg.errors.Diagnostic, warnings: list[str]) -> None:
    if told.severity_nonlocalized == "WARNING":
        warnings.append(told.message_primary or "a warning")


@contextlib.contextmanager
def _told() -> Iterator[None]:
    """Raise what is told of PostgreSQL's errors in one line."""
    try:
        yield
    except UNFIT as error:
        raise ValueError(_line(error)) from None
    except (psycopg.errors.QueryCanceled, psycopg.errors.LockNotAvailable) as error:  # a setting will do so again
        raise HistoryError(f"PostgreSQL: {_line(error)}") from None
    except (psycopg.OperationalError, psycopg.InterfaceError) as error:
        raise UnansweredError(f"PostgreSQL: {_line(error)}") from None
    except psycopg.Error as error:
        raise HistoryError(f"PostgreSQL: {_line(error)}") from None


def _line(error: Exception) -> str:
    return " ".join(str(error).split()) or type(error).__name__
