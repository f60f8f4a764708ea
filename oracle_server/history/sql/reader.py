"""Reading: each query on a connection of its own and in a thread, so that nothing waits for it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import AsyncGenerator, Callable, Sequence
from functools import partial
from typing import ClassVar, TypeVar

import structlog

from oracle_server.core.errors import HistoryError
from oracle_server.history.port import DELETED
from oracle_server.history.readers import Readers
from oracle_server.history.sql.database import Database
from oracle_server.history.sql.rows import Row

T = TypeVar("T")
R = TypeVar("R")
Values = Sequence[object]
MOST_BYTES = 2**20
"""A page has no more rows behind the one by which it has so many bytes, or characters."""
FIRST_PAGE = 64
"""Rows of a first page: a database may give all at once, and how long they are is not known yet."""
log = structlog.get_logger()


class Reader:
    """Reads what is committed. Every method raises `HistoryError` where the database can't be read."""

    errors: ClassVar[tuple[type[Exception], ...]] = ()
    """What a connection raises where the database can't be read, besides `HistoryError`."""

    def __init__(self, threads: Readers, sorting: Readers | None = None) -> None:
        """Read in some threads; put much in order in others, where given."""
        self._threads, self._sorting = threads, sorting or threads
        self._told = set[str]()

    async def all(self, make: Callable[[Row], T], sql: str, values: Values = ()) -> list[T]:
        """What is made of each row, in the thread that reads them."""
        return await self.run(lambda reader: [make(row) for row in reader.execute(sql, values)])

    async def some(self, make: Callable[[Row], T], sql: str, values: Values = ()) -> list[T]:
        """The same of the first rows, where these are long: at least one of them."""
        return await self.run(lambda reader: [make(row) for row in _first(reader, sql, values)[0]])

    async def sound(self, make: Callable[[Row], T], sql: str, values: Values = ()) -> list[T]:
        """The same without the rows of which it can't be made: the log tells of each once."""
        found = await self.all(partial(_made, make), sql, values)
        for error in {str(each) for each in found if isinstance(each, HistoryError)} - self._told:
            self._told.add(error)
            log.error("left alone", error=error)
        return [each for each in found if not isinstance(each, HistoryError)]

    async def one(self, make: Callable[[Row], T], sql: str, values: Values = ()) -> T | None:
        """What is made of the first row, None where there is none."""
        found = await self.all(make, sql, values)
        return found[0] if found else None

    async def row(self, sql: str, values: Values = ()) -> Row:
        """The row of a query that always has one."""
        return (await self.all(tuple, sql, values))[0]

    async def run(self, work: Callable[[Database], T]) -> T:
        """Read with a connection that is closed afterwards, in a thread; cancelled, it ends what it reads."""
        used: list[Database] = []

        def run() -> T:
            with contextlib.closing(self._connect()) as reader:
                used.append(reader)
                return work(reader)

        try:
            return await self._in_thread(run)
        except asyncio.CancelledError:
            for reader in used:
                with contextlib.suppress(*self.errors):  # it is closed already
                    reader.interrupt()
            raise

    async def pages(
        self, make: Callable[[Row], T], order: str, page: str, values: Values, size: int
    ) -> AsyncGenerator[list[T], None]:
        """What is made of rows, by pages, in an order that no index has.

        `order` selects the rows' keys, which are put into a temporary table of this reader's own; `page` selects rows
        with those keys whose places there are from one number to another, and with these places as their last column.
        A page has `size` rows at most, and fewer where they are long. Raises `HistoryError` where one was deleted
        meanwhile: without it, what is read would look whole. So no read stays open between two pages: the
        database's log could not be taken in meanwhile, and would grow without bound.
        """
        reader = await self._in_thread(self._connect)
        in_use = threading.Lock()

        def total() -> int:
            with in_use:
                return int(reader.execute("SELECT count(*) FROM sorted").fetchone()[0])

        def read(first: int, last: int) -> tuple[list[T], int]:
            """What is made of rows, and the place behind the last one."""
            with in_use:
                rows, is_cut = _first(reader, page, (*values, first, last))
                behind = (int(rows[-1][-1]) if is_cut else last) + 1
                if len(rows) < behind - first:
                    raise HistoryError(DELETED)
                return [make(row[:-1]) for row in rows], behind

        def sort() -> None:
            with in_use:
                self._sort(reader, order, values)

        try:
            # this takes seconds of a long session, and needs the interpreter for none of them
            await self._in_thread(sort, self._sorting)
            count, first, rows = await self._in_thread(total), 1, min(FIRST_PAGE, size)
            while first <= count:
                found, behind = await self._in_thread(partial(read, first, min(first + rows - 1, count)))
                yield found
                first, rows = behind, following(rows, behind - first, size)
        finally:
            reader.interrupt()
            close = partial(_close, reader, in_use)  # a thread may still read where this is cancelled: it would crash
            if in_use.locked():
                self._threads.start(close)
            else:  # not by these threads, which end with the history, and leave open what waits for them
                asyncio.get_running_loop().run_in_executor(None, close)

    def _sort(self, reader: Database, order: str, values: Values) -> None:
        """Keep what is selected in a table `sorted` of the connection's own, with its places as `rowid`."""
        reader.execute(f"CREATE TEMP TABLE sorted AS {order}", values)

    async def _in_thread(self, work: Callable[[], R], threads: Readers | None = None) -> R:
        try:
            return await (threads or self._threads).start(work)
        except self.errors as error:
            raise HistoryError(f"the history can't be read: {error}") from None

    def _connect(self) -> Database:
        """A connection that any thread may use, and this alone."""
        raise NotImplementedError


def following(rows: int, came: int, most: int) -> int:
    """How many rows are asked for next: fewer came than were asked for where these were long."""
    return min(most, 4 * rows if came == rows else max(1, 2 * came))


def _first(reader: Database, sql: str, values: Values) -> tuple[list[Row], bool]:
    """The first rows, up to `MOST_BYTES`; whether that is why there are no more of them."""
    found, size = list[Row](), 0
    with contextlib.closing(reader.execute(sql, values)) as cursor:
        for row in cursor:
            found.append(row)
            size += sum([len(value) for value in row if isinstance(value, str | bytes)])
            if size >= MOST_BYTES:
                return found, True
    return found, False


def _close(reader: Database, in_use: threading.Lock) -> None:
    with in_use:
        reader.close()


def _made(make: Callable[[Row], T], row: Row) -> T | HistoryError:
    try:
        return make(row)
    except HistoryError as error:
        return error
