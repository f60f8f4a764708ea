"""When a snapshot of a session is taken: a restart judges only later steps again, and earlier ones may be deleted."""

from __future__ import annotations

import gc
import time
from collections.abc import Mapping

import structlog

from oracle_server.core.session import Session
from oracle_server.history.port import Writing
from oracle_server.history.records import SnapshotRecord
from oracle_server.sessions.monitor import Monitor

_SAVE_AFTER = 10_000
"""Steps before the first snapshot, and at least between two that are not requested."""
_REST = 500
"""For this many times the duration of a snapshot, no other one is taken only to make room."""

log = structlog.get_logger()


class Snapshots:
    """Takes snapshots of one session, less often as it grows, since their cost grows with it."""

    def __init__(self, session: str, number: int, core: Session, history: Writing) -> None:
        """Take snapshots of the session with this `number` in the history."""
        self._session, self._number, self._core, self._history = session, number, core, history
        self._next = _SAVE_AFTER
        self._committed = 0
        self._broken = 0
        self._rested = 0.0

    def resume(self, position: int) -> None:
        """Continue a restored session at a position."""
        self._committed, self._next = position, position + _SAVE_AFTER
        self._broken = len(self._failed)

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
        return position >= self._next

    def save(self, position: int, monitors: Mapping[str, Monitor]) -> None:
        """Take a snapshot after the step at a position, which must be written to the history.

        The monitors' numbers are as of the last commit: steps up to there are not needed for a restart.
        """
        if self._core.asking:
            return  # the order is ahead of what was judged
        self._next = position + max(_SAVE_AFTER, position // 4)
        begin = time.thread_time()  # the time of this thread alone
        gc.disable()  # a snapshot makes many short-lived objects, which each collection would look through
        try:
            self._save(position, monitors)
        finally:
            gc.enable()
        self._rested = time.monotonic() + (time.thread_time() - begin) * _REST

    def _save(self, position: int, monitors: Mapping[str, Monitor]) -> None:
        data = self._core.snapshot()
        if data is None:
            return
        numbers = {name: monitor.numbering.saved() for name, monitor in monitors.items()}
        self._history.save_snapshot(self._number, SnapshotRecord(position, data, self._committed, numbers))

    @property
    def rested(self) -> bool:
        """Whether a snapshot only to make room may be taken now: all sessions wait while one is taken."""
        return time.monotonic() >= self._rested

    @property
    def _failed(self) -> list[tuple[str, str]]:
        return [
            (state.property.id, state.broken)
            for judge in self._core.judges.values()
            for state in judge.properties
            if state.broken is not None
        ]
