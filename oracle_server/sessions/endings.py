"""How sessions end, and where they begin anew."""

from __future__ import annotations

import asyncio
from collections.abc import Mapping

from oracle_server.core.errors import HistoryError
from oracle_server.core.session import Session
from oracle_server.history.port import History, Reading
from oracle_server.history.records import Document, SessionRecord
from oracle_server.process.clock import MAX_APART, Clock
from oracle_server.sessions.runs import beginning, last_run, named, run_of
from oracle_server.wire.errors import WireError

BY_REQUEST = "by request"
"""Why a session was closed that somebody closed."""
DELETED_THERE = "its robot has deleted it"
"""Why a session is over that a robot has forwarded, but not to its end."""
SPEC_CHANGED = "its spec was changed"
"""Why a session is over whose adapter judges by itself, and was started with another text of its spec."""
CLOCK_SET_BACK = "the machine's clock was set back"
"""Why a session is over that has lived later than the clocks tell: all that comes would be late, and at one time."""
CLOCK_WENT_BACK = "its simulated time went back"
"""Why a session is over whose simulation was restarted."""


def is_ahead(core: Session, clock: Clock) -> bool:
    """Whether a session has lived later than it is by the machine's clock, by more than clocks may differ."""
    return core.simulated is None and clock.ahead > max(MAX_APART, core.plan.spec.ordering.max_skew)


class Runs:
    """The runs of sessions that a server has, open or closed."""

    def __init__(self, history: Reading, open_: Mapping[str, object], unrestored: Mapping[str, object]) -> None:
        """Look among the sessions that are open, or could not be restored, by their names, and in a history."""
        self._history, self._open, self._unrestored = history, open_, unrestored

    async def goes_on(self, name: str) -> bool:
        """Whether a name that is not known is that of a session of which later runs are."""
        return run_of(name)[1] == 1 and await self._last(name) is not None

    async def following(self, name: str) -> str:
        """The name of the run behind all that are known."""
        last = await self._last(name)
        return named(run_of(name)[0], 2 if last is None else run_of(last)[1] + 1)

    async def anew(self, name: str) -> str:
        """The last run of a session where it is open, else the one in which it is to begin anew."""
        last = await self._last(name)
        return last if last is not None and last in self._open else await self.following(name)

    async def _last(self, name: str) -> str | None:
        stem, _ = run_of(name)
        return last_run(stem, {*self._open, *self._unrestored, *await self._history.names(beginning(stem))})


async def note_closed(history: History, number: int, now: int, state: Document) -> None:
    """Keep that a session is closed. Raises `HistoryError` where that can't be kept."""
    committed = asyncio.Event()
    history.close_session(number, now, state, committed.set)
    await history.flush()
    if not committed.is_set():
        raise HistoryError("the history refuses how it stands, see above")


def end_of(now: int, because: str) -> Document:
    """What the state of a session that is closed says of its end."""
    return {"status": "closed", "closed": now, "closed_because": because, "live": False, "idle": False}


def ended(session: str, why: str, successor: str | None) -> WireError:
    """What monitors of a session are told that goes on as another one; None for one without a name."""
    message = f"session '{session}' is over: {why}; attach to {successor or 'a new one'}"
    return WireError("session_ended", message, fatal=True, session=successor)


async def over(record: SessionRecord, state: Document, instance: str, history: Reading, runs: Runs) -> WireError:
    """What a process (its `instance`) is told that wants to join a closed session: where it begins anew, if it may.

    It may not where it was there before somebody closed the session. Raises `HistoryError`.
    """
    because = state.get("closed_because") or BY_REQUEST
    if state.get("clock_went_back"):
        return ended(record.id, because, None if record.private else await runs.anew(record.id))
    was_there = any(monitor.instance == instance for monitor in await history.monitors(record.number))
    if record.private or (was_there and because == BY_REQUEST):
        why = f"session '{record.id}' is closed ({because}); it can only be read"
        return WireError("session_closed", why, fatal=True)
    return ended(record.id, f"it was closed, {because}", await runs.anew(record.id))
