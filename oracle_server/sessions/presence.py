"""Whether a session has monitors, and what comes of it where it has none, or none for long."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from oracle_server.core.spec import Spec
from oracle_server.core.units import span
from oracle_server.history.records import SessionRecord
from oracle_server.process.clock import Clock
from oracle_server.sessions.apart import Apart
from oracle_server.sessions.monitor import Monitor

IDLE = 600 * 10**9
"""How long (ns) an open session is without a monitor before it is called idle."""


class Presence:
    """Since when a session has no monitor; asks for its closing where that lasts for as long as its spec says."""

    def __init__(
        self, record: SessionRecord, monitors: Mapping[str, Monitor], clock: Clock, spec: Spec,
        close: Callable[[str], None],
    ) -> None:  # fmt: skip
        """Begin without a monitor since the session was opened; later ones are added to `monitors`.

        `close` is called with the reason after the spec's `close_after` without one, not before `watch` was called.
        """
        self.without_since: int | None = record.opened
        """Since when (ns) no monitor is there; None while one is."""
        self._record, self._monitors, self._clock, self._close = record, monitors, clock, close
        self.apart = Apart(spec, monitors)
        """What is held for one of them, and not seen at the events of others."""
        self._limit = spec.close_after
        self._watches = False
        self._timer: asyncio.TimerHandle | None = None

    @property
    def is_live(self) -> bool:
        """Whether a monitor is there, or its place is kept."""
        return self.without_since is None

    def is_idle(self, now: int) -> bool:
        """Whether the session is without a monitor for long."""
        return self.without_since is not None and now - self.without_since >= IDLE

    def note(self, unknown: int | None = None) -> None:
        """Note which monitors are there; one that left at a time that was not kept did so at `unknown` (ns)."""
        since = None
        if not any(m.attached for m in self._monitors.values()):
            since = max((m.left or unknown or 0 for m in self._monitors.values()), default=self._record.opened)
        if since != self.without_since:
            self.without_since = since
            self._arm()

    def leave_empty(self) -> None:
        """Have a private session closed where no monitor is there."""
        if self._record.private and not any(m.attached for m in self._monitors.values()):
            self._close("its last monitor left")

    def watch(self) -> None:
        """From now on, have the session closed once it was without a monitor for too long."""
        self._watches = True
        self._arm()

    def stop(self) -> None:
        """Have nothing closed any more."""
        self._watches = False
        self._arm()

    def _arm(self) -> None:
        if self._timer:
            self._timer.cancel()
            self._timer = None
        if self._watches and self._limit is not None and self.without_since is not None:
            left = self.without_since + self._limit - self._clock.now()
            self._timer = asyncio.get_running_loop().call_later(max(0, left) / 10**9, self._look)

    def _look(self) -> None:
        """Close, or wait on where the server's time has gone more slowly than the timer's."""
        if self._limit is None or self.without_since is None:
            return
        if self._clock.now() - self.without_since >= self._limit:
            self._close(f"no monitor for {_written(self._limit)} (`close:` of its spec)")
        else:
            self._arm()


def _written(time: int) -> str:
    """A duration (ns) in hours or minutes where it is some whole number of these."""
    for unit, size in (("h", 3600 * 10**9), ("min", 60 * 10**9)):
        if time % size == 0:
            return f"{time // size}{unit}"
    return span(time)
