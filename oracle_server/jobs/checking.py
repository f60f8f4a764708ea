"""Texts of specs, for the process that checks them: one after the other, of all clients in turns."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import msgspec

from oracle_server.core.errors import OracleError
from oracle_server.history.readers import Readers
from oracle_server.jobs import checks
from oracle_server.jobs.checks import Checked, Request
from oracle_server.process.worker import Worker, WorkerError

WITHIN = 20.0
"""Seconds that a check may take."""
WAITING = 20
"""Checks that may wait for others."""
_checked = msgspec.msgpack.Decoder(Checked).decode


class UncheckedError(OracleError):
    """A text that could not be checked: neither is it sound nor is anything found in it."""


class CrowdedError(OracleError):
    """More waits to be done for clients than may."""


class Checking:
    """Asks a process, which is started with the first text."""

    def __init__(self, types: Sequence[Path] = ()) -> None:
        """Check by the types of some folders, and of what is sourced."""
        self._worker = Worker(checks.__name__, [str(folder) for folder in types])
        self._threads = Readers(1, 1, "spec checks")

    async def check(self, spec_id: str, text: str) -> Checked:
        """What `check` says of a text. Raises `UncheckedError`, or `CrowdedError` where too many wait."""
        if self._threads.waiting >= WAITING:
            raise CrowdedError("too many specs wait to be checked; try again in some seconds")
        found = await self._threads.start(partial(self._ask, Request(spec_id, text)))
        if found.error is not None:
            raise UncheckedError(f"the spec can't be checked: {found.error}")
        return found

    def close(self) -> None:
        """End the process."""
        self._worker.close()
        self._threads.close()

    def _ask(self, request: Request) -> Checked:
        try:
            return _checked(self._worker.ask(request, WITHIN))
        except WorkerError as error:
            raise UncheckedError(f"the spec can't be checked: {error}") from None
