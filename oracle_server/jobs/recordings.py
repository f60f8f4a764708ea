"""Recordings that clients send to be judged, each in its turn, one of each client, in a process each."""

from __future__ import annotations

import asyncio
import contextlib
import os
import secrets
from collections import OrderedDict
from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import structlog

from oracle_server.core.errors import HistoryError, OracleError
from oracle_server.core.units import counted
from oracle_server.history.records import Document
from oracle_server.jobs.checking import CrowdedError
from oracle_server.jobs.frames import Ended, Failed, Progress, Rows, Started, Task
from oracle_server.jobs.judge import Judge, JudgeError
from oracle_server.jobs.turns import Turns
from oracle_server.jobs.uploads import Uploads
from oracle_server.process.shortage import shortage
from oracle_server.sessions.opening import Begun
from oracle_server.sessions.recorded import RecordedSession
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Entry, Library

MOST = 8
"""Recordings that are received, wait, or are judged."""
_REMEMBERED = 100
"""Of those that have ended."""
_CANCELLED = "it was cancelled"
_STOPPED = "the server was stopped while it was judged"

State = Literal["receiving", "queued", "judging", "judged", "failed", "cancelled"]

log = structlog.get_logger()


@dataclass(slots=True)
class Recording:
    """One recording: whose, of which name and size, by which spec, and how far it has got.

    `session` is the one that it has been given, or is to have, None where that has no name yet; `read` of `total` units
    are read. `error` says why it has failed, `conclusion` what a replay concludes.
    """

    id: str
    client: str
    name: str
    spec: str
    session: str | None
    state: State = "receiving"
    size: int = 0
    events: int = 0
    read: int = 0
    total: int = 0
    rows: int = 0
    opened: bool = False
    complete: bool = False
    error: str | None = None
    conclusion: Document | None = None
    ended: asyncio.Event = field(default_factory=asyncio.Event)
    task: asyncio.Task[Any] | None = None
    unwanted: bool = False
    """Whether it is to end before its time."""

    def stop(self) -> None:
        """End before its time."""
        self.unwanted = True
        if self.task is not None:
            self.task.cancel()

    @property
    def document(self) -> Document:
        """What its session's state says of it."""
        return {
            "recording": {
                "name": self.name, "size": self.size, "events": self.events, "read": self.read, "total": self.total,
                "complete": self.complete, "conclusion": self.conclusion,
            }
        }  # fmt: skip


class UnwantedError(OracleError):
    """A recording that is cancelled while it is received."""


class Recordings:
    """Receives recordings, and has them judged."""

    def __init__(
        self, registry: Registry, library: Library, uploads: Uploads, types: Sequence[Path] = (),
        most_rows: int | None = None,
    ) -> None:  # fmt: skip
        """Judge by the specs of a library; `types` are folders with types of messages.

        `most_rows`: so many of a recording are kept, where the history is in memory.
        """
        self.uploads = uploads
        self._registry, self._library, self._most_rows = registry, library, most_rows
        self._types = [os.fsencode(folder) for folder in types]
        self._all: OrderedDict[str, Recording] = OrderedDict()
        self._turns = Turns()
        self._stopping = False

    def listed(self) -> list[Recording]:
        """All that are known, the newest first."""
        return [*reversed(self._all.values())]

    def find(self, recording_id: str) -> Recording | None:
        """The one of an id."""
        return self._all.get(recording_id)

    async def take(
        self, client: str, name: str, spec: str, session: str | None, body: AsyncIterator[bytes], size: int
    ) -> Recording:
        """Receive a recording of a client, of which `size` bytes are announced, and let it wait for its turn.

        Raises `CrowdedError`, `TooLargeError`, `FullError`, and what finding the spec raises; `UnwantedError` where it
        is cancelled meanwhile.
        """
        entry = await self._library.find(spec)
        self._demand_place(client)
        self.uploads.check_size(size)
        self.uploads.check_room(size)
        one = Recording(secrets.token_hex(8), client, name, spec, session, size=size)
        self._all[one.id] = one
        path = await self._received(one, body)
        one.size, one.state = path.stat().st_size, "queued"
        one.task = asyncio.create_task(self._judged(one, entry, path))
        await asyncio.sleep(0)  # what has not begun can't end in order where it is cancelled
        return one

    async def cancel(self, one: Recording, within: float) -> None:
        """End a recording before its time; returns once it has ended, or after so many seconds."""
        if not one.ended.is_set():
            one.stop()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(within):
                    await one.ended.wait()

    async def stop(self) -> None:
        """End all of them: their sessions are closed as incomplete."""
        going = [one for one in self._all.values() if not one.ended.is_set()]
        tasks = [one.task for one in going if one.task is not None and not one.task.done()]
        self._stopping = True
        for one in going:
            one.stop()
        if tasks:
            await asyncio.wait(tasks, timeout=5.0)

    async def _received(self, one: Recording, body: AsyncIterator[bytes]) -> Path:
        """Where a recording is once all of it has come; nothing of it is left, and known, where it does not."""
        one.task = asyncio.create_task(self.uploads.receive(one.name, body))
        path: Path | None = None
        try:
            path = await one.task
        except BaseException:
            if not one.unwanted or _is_cancelled():
                del self._all[one.id]
                one.ended.set()  # who cancels it meanwhile is waiting for that
                raise
        if path is not None and not one.unwanted:
            return path
        if path is not None:
            await self.uploads.remove(path)
        one.state, one.error = "cancelled", self._why()
        one.ended.set()
        raise UnwantedError(f"the recording is not judged: {one.error}")

    def _why(self) -> str:
        """Why one has ended before its time."""
        return _STOPPED if self._stopping else _CANCELLED

    def _demand_place(self, client: str) -> None:
        going = [one for one in self._all.values() if not one.ended.is_set()]
        if any(one.client == client for one in going):
            raise CrowdedError("another recording of yours is not judged to its end yet: wait for it, or cancel it")
        if len(going) >= MOST:
            raise CrowdedError(f"{counted(len(going), 'recording')} wait to be judged already; try again later")
        ended = [one.id for one in self._all.values() if one.ended.is_set()]
        for old in ended[: max(0, len(ended) - _REMEMBERED)]:
            del self._all[old]

    async def _judged(self, one: Recording, entry: Entry, path: Path) -> None:
        """Judge a recording once it is its turn, whatever comes of it."""
        judging = _Judging(one, entry, self._registry, self.uploads, self._most_rows)
        state: State = "failed"
        task = Task(os.fsencode(path), one.name, entry.file.text, self._types, 4 * self.uploads.most_bytes)
        try:
            async with self._turns.one():
                one.state = "judging"
                await judging.run(task)
            state, one.complete = "judged", True
        except asyncio.CancelledError:
            state, one.error = "cancelled", self._why()
        except OracleError as error:
            one.error = str(error)
        except Exception as error:
            short = shortage(error)
            log.error("a recording can't be judged", recording=one.id, reason=short, exc_info=short is None)
            one.error = short or "the server failed to judge it; see its log"
        finally:
            await asyncio.shield(asyncio.create_task(self._finish(one, judging, path, state)))

    async def _finish(self, one: Recording, judging: _Judging, path: Path, state: State) -> None:
        """Tell what has become of a recording once its session is closed."""
        try:
            await self.uploads.remove(path)
            await judging.close()
        except Exception:
            log.exception("a recording can't be closed", recording=one.id)
            state, one.error = "failed", "the server failed to close its session; see its log"
        finally:  # its client's place is free, and nobody waits for it without an end
            one.state = state
            one.ended.set()


def _is_cancelled() -> bool:
    """Whether who sends a recording is waited for no more."""
    task = asyncio.current_task()
    return task is not None and task.cancelling() > 0


class _Judging:
    """One recording while it is judged, and the session that it is judged in."""

    def __init__(
        self, one: Recording, entry: Entry, registry: Registry, uploads: Uploads, most_rows: int | None
    ) -> None:
        self._one, self._entry, self._registry, self._uploads = one, entry, registry, uploads
        self._most_rows = most_rows
        self._session: RecordedSession | None = None

    async def run(self, task: Task) -> None:
        """Keep what is judged, until its end. Raises `OracleError` where it does not come to that."""
        async with contextlib.aclosing(Judge(task).frames()) as frames:
            async for frame in frames:
                if isinstance(frame, Ended):
                    self._one.conclusion = frame.conclusion
                    self._tell(frame.state, settled=True)
                    return
                await self._take(frame)
        raise JudgeError("the process that judges it has ended before its time")

    async def _take(self, frame: Started | Rows | Progress | Failed) -> None:
        one = self._one
        if isinstance(frame, Failed):
            if frame.state is not None:
                self._tell(frame.state, settled=True)
            raise JudgeError(frame.error)
        if isinstance(frame, Started):
            task = one.task
            assert task is not None  # noqa: S101 -- this runs in it
            begun = Begun(frame.by, frame.decides, frame.begun)
            self._session = await self._registry.create_recorded(self._entry, one.session, begun, task.cancel)
            one.session, one.opened = self._session.record.id, True
        elif isinstance(frame, Progress):
            one.events, one.read, one.total = frame.events, frame.read, frame.size
            self._uploads.check_room()
            self._tell(frame.state or {})
        else:
            await self._keep(frame)

    async def _keep(self, rows: Rows) -> None:
        session = self._session
        if session is None:
            raise JudgeError("the process that judges it said what it can't say yet")
        self._one.rows += len(rows.steps)
        if self._most_rows is not None and self._one.rows > self._most_rows:
            raise HistoryError(f"the history is kept in memory, and takes {self._most_rows} steps of a recording")
        await session.keep(rows.steps, rows.revisions, rows.episodes)

    def _tell(self, state: Document, *, settled: bool = False) -> None:
        if self._session is not None:
            self._session.tell(state | self._one.document, settled=settled)

    async def close(self) -> None:
        """Close the session, if there is one, as what has become of it."""
        if self._session is None:
            return
        self._tell({})
        because = self._one.error or "the recording was judged to its end"
        await self._registry.close_recorded(self._session, because, complete=self._one.complete)
