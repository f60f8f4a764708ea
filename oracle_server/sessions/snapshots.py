"""When a snapshot of a session is taken: a restart judges only later steps again, and earlier ones may be deleted.

The steps of all sessions that no snapshot has count together, in a `Backlog`.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping

import structlog

from oracle_server.core.session import Session
from oracle_server.history.port import Writing
from oracle_server.history.records import SnapshotRecord
from oracle_server.sessions.backlog import Backlog
from oracle_server.sessions.monitor import Monitor

_SAVE_AFTER = 10_000
"""Steps after which a session takes a snapshot, whatever the others do."""
_LIGHT = 10
"""Properties of a step that counts once in the backlog; judging more takes as many times longer."""
_REST = 500
"""For this many times the duration of a snapshot, no other one is taken unless it must: all sessions wait meanwhile."""
_ASK_AGAIN = 0.1
"""Seconds until a snapshot is tried again that could not be taken: an oracle is asked, or a pass goes on."""

log = structlog.get_logger()


class Snapshots:
    """Takes snapshots of one session, the less often the longer they take."""

    def __init__(
        self, session: str, number: int, core: Session, history: Writing, backlog: Backlog, save: Callable[[], None]
    ) -> None:
        """Take snapshots of the session with this `number` in the history; the backlog may request one by `save`."""
        self._session, self._number, self._core, self._history = session, number, core, history
        self._backlog, self.request = backlog, save
        self._weight = 1 + len(core.plan.spec.properties) // _LIGHT
        self._saved = 0
        self._savable = True
        self._committed = 0
        self._broken = 0
        self._rested = 0.0

    def resume(self, position: int, saved: int) -> None:
        """Continue a restored session at a position, whose snapshot is of another one."""
        self._committed, self._saved = position, saved
        self._broken = len(self._failed)
        self._backlog.restored(self, (position - saved) * self._weight)

    def end(self) -> None:
        """Count no longer: the session is closed, and no restart will judge it again."""
        self._backlog.forget(self)

    def committed(self, position: int) -> None:
        """Record that all steps up to a position are committed, and settled in the monitors' numbers."""
        self._committed = position

    def is_due(self, position: int) -> bool:
        """Whether to take a snapshot at a position: after many steps, or where an engine failed.

        An engine may fail at a tick that changed nothing, which the history does not have: judging the steps again
        would not find the failure.
        """
        broken = self._failed
        if len(broken) > self._broken:
            self._broken = len(broken)
            log.warning(
                "a property is no longer judged", session=self._session, property=broken[-1][0], reason=broken[-1][1]
            )
            return True
        self._count(position)
        return position - self._saved >= _SAVE_AFTER and self.rested

    def save(self, position: int, monitors: Mapping[str, Monitor]) -> None:
        """Take a snapshot after the step at a position, which must be written to the history.

        The monitors' numbers are as of the last commit: steps up to there are not needed for a restart.
        """
        if not self._core.can_be_saved:
            self._rested = time.monotonic() + _ASK_AGAIN
            return
        begin = time.thread_time()  # the time of this thread alone
        gc.disable()  # a snapshot makes many short-lived objects, which each collection would look through
        try:
            self._save(position, monitors)
        finally:
            gc.enable()
        self._rested = time.monotonic() + (time.thread_time() - begin) * _REST

    def _save(self, position: int, monitors: Mapping[str, Monitor]) -> None:
        data = self._core.snapshot()
        self._saved, self._savable = position, data is not None
        if data is None:
            self._backlog.forget(self)
            return
        self._count(position)
        if "revising" in data:  # a late event may still change what was judged after that
            position = data["revising"]["position"]
            if not position:
                return
        numbers = {name: monitor.numbering.saved() for name, monitor in monitors.items()}
        settled = min(position, self._committed)
        self._history.save_snapshot(self._number, SnapshotRecord(position, data, settled, numbers))

    @property
    def rested(self) -> bool:
        """Whether a snapshot that can wait may be taken now: all sessions wait while one is taken."""
        return time.monotonic() >= self._rested

    def _count(self, position: int) -> None:
        if self._savable:
            self._backlog.count(self, (position - self._saved) * self._weight)

    @property
    def _failed(self) -> list[tuple[str, str]]:
        return [
            (state.property.id, state.broken)
            for judge in self._core.judges.values()
            for state in judge.properties
            if state.broken is not None
        ]
