"""What new sessions are kept by: their numbers, their names, and how they begin."""

from __future__ import annotations

import contextlib
import itertools
import secrets
import time
from collections.abc import Awaitable, Callable, Iterator
from typing import NamedTuple

from oracle_server.core.errors import HistoryError, OracleError
from oracle_server.core.events import By, Order
from oracle_server.core.plan import Plan
from oracle_server.core.session import Session
from oracle_server.core.spec import UNREACHABLE
from oracle_server.engines.table import make_engines
from oracle_server.history.port import History
from oracle_server.history.records import Kind, SessionRecord
from oracle_server.process.clock import Clock
from oracle_server.specfiles.library import Entry, UnknownSpecError
from oracle_server.wire.errors import WireError

_UNWRITTEN = 1_000
"""Rows that may wait for a history that fails before no more sessions are opened: each retry of a monitor opens one."""


class SessionExistsError(OracleError):
    """A session of that name exists already."""


class SessionNameError(OracleError):
    """A name that no session may be given."""


class Begun(NamedTuple):
    """How a session begins: the order asked for instead of its spec's, that which decides, and when (ns, its own)."""

    by: By | None
    decides: Order
    at: int | None = None


def unopened(error: OracleError) -> WireError:
    """What a monitor is told whose session can't be opened."""
    code = {UnknownSpecError: "unknown_spec", SessionNameError: "bad_attach"}.get(type(error), "bad_spec")
    return WireError(code, str(error), fatal=True)


class Records:
    """Makes the records of new sessions."""

    def __init__(self, history: History, clock: Clock, known: Callable[[str], Awaitable[SessionRecord | None]]) -> None:
        """`known` finds a session's record by its name."""
        self.last = 0
        """The number of the session that was opened last."""
        self._noted: set[int] | None = None
        self._history, self._clock, self._known = history, clock, known

    @contextlib.contextmanager
    def noting(self) -> Iterator[set[int]]:
        """The numbers of the sessions that are made within this."""
        self._noted = noted = set[int]()
        try:
            yield noted
        finally:
            self._noted = None

    async def demand_free(self, name: str | None) -> None:
        """Raise `SessionExistsError` where a session has a name already, `SessionNameError` where none may have it."""
        if name is not None and await self._known(name) is not None:
            raise SessionExistsError(f"a session '{name}' exists already")
        if name in UNREACHABLE:
            raise SessionNameError(f"no session can be called '{name}', which paths leave out; take another name")

    async def new_name(self, spec_id: str) -> str:
        """A name that no session has, even where many are opened within a second."""
        stem = f"{spec_id[:40]}-{time.strftime('%Y%m%d-%H%M%S')}"
        for _ in itertools.count():
            name = f"{stem}-{secrets.token_hex(2)}"
            if await self._known(name) is None:
                break
        return name

    async def make(
        self, entry: Entry, name: str, begun: Begun, *, private: bool = False, kind: Kind = "robot"
    ) -> SessionRecord:
        """The record of a new session.

        Raises `HistoryError` where the history fails, and `SessionExistsError` where another server takes the name.
        """
        failure = self._history.failure
        if failure is not None and self._history.pending > _UNWRITTEN:
            raise HistoryError(f"no session is opened while the history can't be written: {failure}")
        number = await self._history.reserve(name, self.last + 1)
        if number is None:
            raise SessionExistsError(f"a session '{name}' exists already")
        self.last = max(self.last, number)
        if self._noted is not None:
            self._noted.add(number)
        spec = entry.plan.spec
        return SessionRecord(
            number, name, spec.id, entry.file.text, spec.digest, tuple([p.id for p in spec.properties]), private,
            self._clock.since(0).now(), begun.by, begun.at, begun.decides, kind,
        )  # fmt: skip


def fresh(plan: Plan) -> Session:
    """A session that has judged nothing yet: of a thousand properties it takes longer than a decision may wait."""
    return Session(plan, make_engines(plan))
