"""When a session is saved, so that a restart need not judge it all again, and what of its history may go then."""

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
"""Steps until the first snapshot, and at least between two that nobody asked for."""
_REST = 500
"""How many times as long as it took to save a session it is not saved to make room."""

log = structlog.get_logger()


class Snapshots:
    """Saves one session, ever more seldom as it grows: what a snapshot takes grows with it."""

    def __init__(self, session: str, number: int, core: Session, history: Writing) -> None:
        """Save a session under its `number` in the history."""
        self._session, self._number, self._core, self._history = session, number, core, history
        self._next = _SAVE_AFTER
        self._committed = 0
        self._broken = 0
        self._rested = 0.0

    def resume(self, position: int) -> None:
        """Go on with a session that was restored, and stands at a position."""
        self._committed, self._next = position, position + _SAVE_AFTER
        self._broken = len(self._no_more_judged)

    def committed(self, position: int) -> None:
        """Know that all up to a position is committed, and that the monitors' numbers say so."""
        self._committed = position

    def is_due(self, position: int) -> bool:
        """Whether to save a session that stands at a position: after many steps, or where a property broke.

        A tick that changed nothing is not in the history, and what it cost is not known to who judges all again.
        """
        broken = self._no_more_judged
        if len(broken) > self._broken:
            self._broken = len(broken)
            log.warning(
                "a property is judged no more", session=self._session, property=broken[-1][0], reason=broken[-1][1]
            )
            return True
        return position >= self._next

    def save(self, position: int, monitors: Mapping[str, Monitor]) -> None:
        """Save how all stands after the step at a position, which was given to the history.

        The monitors' numbers are as of the last commit: steps up to there are needed no more.
        """
        if self._core.asking:
            return  # the order is ahead of what was judged
        self._next = position + max(_SAVE_AFTER, position // 4)
        begin = time.thread_time()  # what others took of the processor meanwhile is not its cost
        gc.disable()  # as many objects are made as values are known, and are gone soon: each search would see them all
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
        """Whether to save now, where it could as well be done later: all other sessions wait meanwhile."""
        return time.monotonic() >= self._rested

    @property
    def _no_more_judged(self) -> list[tuple[str, str]]:
        return [
            (state.property.id, state.broken)
            for judge in self._core.judges.values()
            for state in judge.properties
            if state.broken is not None
        ]
