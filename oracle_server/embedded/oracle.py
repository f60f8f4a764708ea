"""A data directory's history and sessions in this process: judged in the threads of who brings events."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import structlog

from oracle_server.core.errors import OracleError
from oracle_server.core.spec import Retention
from oracle_server.embedded.line import Ends, Line
from oracle_server.embedded.turns import TurnsLoop
from oracle_server.history.retention import Pruner
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.process.clock import Clock
from oracle_server.process.logs import set_up_warnings
from oracle_server.process.pidfile import PidFile
from oracle_server.process.settings import Settings, load_settings, unknown_variables
from oracle_server.rostypes.known import Types
from oracle_server.sessions.endings import CLOCK_SET_BACK, SPEC_CHANGED, is_ahead
from oracle_server.sessions.registry import Registry
from oracle_server.specfiles.library import Library
from oracle_server.specfiles.load import load_spec

_CLOSE_WITHIN = 5.0
"""Seconds for a session to be closed that can't go on."""
_OF_A_SERVER = ("history", "forward", "alarms", "read_only")
"""Settings of what this does not do: who set one would take it for done."""
_SETTLE_WITHIN = 2.0
"""Seconds for oracles elsewhere, which the adapter has waited for, and will not wait for much longer."""
_LINGER = 1.0
"""Seconds until a line that has ended is forgotten: what it still says has been delivered by then."""

log = structlog.get_logger()


class EmbeddedError(OracleError):
    """The spec or the data directory of an embedded oracle can't be used."""


def log_warnings() -> None:
    """Let the oracle log warnings and errors alone, to stderr: for a program that is its own, since this is global."""
    set_up_warnings()


class EmbeddedOracle:
    """What `oracle-server serve` has of sessions, without its HTTP, for monitors of this process.

    Settings as retention and durability are those of the server's environment. Nothing of the process is changed.
    """

    def __init__(self, spec: Path, data_dir: Path | None, wait: float = 0.0) -> None:
        """Open the data directory for a spec's file; another adapter that has it is waited for, for `wait` seconds.

        Raises `SpecError`, `PidFileError` where another process uses the directory, and other `OracleError`s.
        """
        self._settings = settings = load_settings(data_dir=data_dir)
        _tell_ignored(settings)
        types = Types(settings.type_folders)
        loaded = load_spec(spec, types=types).spec
        self.spec, self._digest = loaded.id, loaded.digest
        self._pid_file = PidFile(settings.data_dir, embedded=True, wait=wait)
        try:
            uploads = settings.data_dir / "specs"
            self._library = Library(spec, uploads, types)
            _require_own(self._library, self.spec, spec)
            self._history = SqliteHistory(settings.data_dir, settings.durability)
        except BaseException:
            self._pid_file.release()
            raise
        self._loop = TurnsLoop()
        self._thread = threading.Thread(target=self._run, name="oracle-session", daemon=True)
        self._lines: set[Line] = set()
        self._tasks: set[asyncio.Task[None]] = set()
        self._ended = False
        self._stopper: threading.Thread | None = None
        self._stopping = threading.Lock()
        self._beside: list[asyncio.Task[None]] = []
        self._loop.before_waiting(self._deliver)

    def start(self) -> None:
        """Restore the open sessions, however long this takes. Raises `OracleError`."""
        self._thread.start()
        try:
            self._submit(self._begin(self._settings)).result()
        except BaseException:
            self._end()
            raise

    def connect(self, ends: Ends, hello: str) -> Line:
        """A monitor's line; its first frame is `attach`."""
        line = Line(self._loop, ends, hello)
        self._loop.call_from_anywhere(self._serve, line)
        return line

    def stop(self, timeout: float) -> bool:
        """Judge what is held, commit it, and close; sessions stay open in the history, as where a server stops.

        False where that takes longer than `timeout` seconds; it goes on, and the data directory is in use meanwhile.
        """
        with self._stopping:
            if self._stopper is None:
                self._stopper = threading.Thread(target=self._stop, name="oracle-stop", daemon=True)
                self._stopper.start()
        self._stopper.join(timeout)
        return not self._stopper.is_alive()

    def _stop(self) -> None:
        if self._ended:
            return
        try:
            if self._thread.is_alive():
                self._submit(self._leave()).result()
        finally:
            self._end()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_forever()

    def _submit(self, work: Coroutine[Any, Any, None]) -> Future[None]:
        return asyncio.run_coroutine_threadsafe(work, self._loop)

    async def _begin(self, settings: Settings) -> None:
        self._history.start(self._loop)
        clock = Clock(at_least=await self._history.last_time())
        self._registry = Registry(self._history, self._library, clock, settings.resume_within)
        bounds = Retention(settings.retain_age, settings.retain_events, settings.retain_size)
        pruner = Pruner(self._history, bounds, self._library.retention, clock.ago, self._registry.save)
        await self._registry.restore_all()
        await self._registry.take_over()
        self._registry.accept_work()
        await self._close_old()
        works = (pruner.run(settings.retain_check), self._history.catch_up())
        self._beside = [self._loop.create_task(work) for work in works]

    async def _close_old(self) -> None:
        """Close sessions that began by another meaning of the spec, or are being closed as the clock was set back.

        Who joins them begins anew, by its file, and by the machine's clock.
        """
        for session in [live for live in self._registry.open.values() if live.spec.id == self.spec]:
            ahead = is_ahead(session.core, session.clock)
            why = CLOCK_SET_BACK if ahead else SPEC_CHANGED
            if not ahead:
                if session.spec.digest == self._digest:
                    continue
                log.warning("a session is closed, and goes on as another run", session=session.id, reason=why)
            if not await self._registry.closed_within(session, _CLOSE_WITHIN, why):
                message = f"session '{session.id}' can't go on, as {why}, and can't be closed now"
                raise EmbeddedError(f"{message}; take another --session")

    async def _leave(self) -> None:
        for task in self._beside:
            task.cancel()
        if self._beside:
            await asyncio.wait(self._beside)
        await self._registry.shut_down(_SETTLE_WITHIN)
        if self._tasks:
            await asyncio.wait(self._tasks, timeout=1.0)

    def _serve(self, line: Line) -> None:
        self._lines.add(line)
        task = self._loop.create_task(line.serve(self._registry))
        self._tasks.add(task)
        task.add_done_callback(lambda ended: self._served(line, ended))

    def _served(self, line: Line, task: asyncio.Task[None]) -> None:
        self._tasks.discard(task)
        self._loop.call_later(_LINGER, self._lines.discard, line)

    def _deliver(self) -> None:
        """Call what is due for monitors, while the loop is not held."""
        for line in self._lines:
            line.deliver()

    def _end(self) -> None:
        self._ended = True
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
        self._history.close()
        self._loop.close()
        self._pid_file.release()


def _tell_ignored(settings: Settings) -> None:
    """Warn of variables of the environment that change nothing here."""
    if unknown := unknown_variables():
        log.warning("environment variables that name no setting are ignored", names=", ".join(unknown))
    fields = Settings.model_fields
    if ignored := [f"ORACLE_{n.upper()}" for n in _OF_A_SERVER if getattr(settings, n) != fields[n].default]:
        what = "settings of a server are ignored: this writes the data directory, forwards nothing, and alarms nobody"
        log.warning(what, names=", ".join(ignored))


def _require_own(library: Library, spec_id: str, path: Path) -> None:
    """Raise `EmbeddedError` where another spec of the same id was uploaded to the data directory."""
    found = library.get(spec_id).path
    if found != path:
        message = f"{path}: {found} has the id '{spec_id}', too, and goes before it"
        raise EmbeddedError(f"{message}; delete that, or take another --data")
