"""A session in which a recording is judged, elsewhere: what comes of it is kept here, as it comes."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Sequence
from functools import partial

import structlog

from oracle_server.core.errors import HistoryError, UnansweredError
from oracle_server.core.revisions import Revision
from oracle_server.history.episodes import StoredEpisode
from oracle_server.history.port import History
from oracle_server.history.records import Document, SessionRecord, StoredStep
from oracle_server.sessions.commits import Commits
from oracle_server.sessions.committed import committed
from oracle_server.sessions.endings import end_of
from oracle_server.sessions.leftopen import left_open
from oracle_server.sessions.shares import Share
from oracle_server.sessions.unrestored import bare

log = structlog.get_logger()

CUT_OFF = "the server ended while it was judged: only a part of the recording was"


class RecordedSession:
    """Keeps what is judged of a recording. Its state is what was told of it last, and incomplete until it is closed."""

    def __init__(self, record: SessionRecord, history: History, share: Share, cancel: Callable[[], object]) -> None:
        """Begin a session, which is kept in the history; `cancel` ends the judging before its time."""
        self.record, self.cancel = record, cancel
        self._share = share
        self.commits, self._closed = Commits(), asyncio.Event()
        self._history = history
        self._told: Document = {}
        self._settled = False
        history.open_session(record)
        log.info("session of a recording opened", session=record.id, spec=record.spec)

    @property
    def state(self) -> Document:
        """How it stands."""
        return bare(self.record) | self._told

    def tell(self, told: Document, *, settled: bool = False) -> None:
        """Take in what is known of the state, in place of what was known before it.

        `settled`: so it stands by all that is kept, and nothing more of that follows.
        """
        self._told |= told
        self._settled = self._settled or settled

    async def keep(
        self, steps: Sequence[StoredStep], revisions: Sequence[Revision], episodes: Sequence[StoredEpisode]
    ) -> None:
        """Keep what was judged next; returns once it is committed. Raises `HistoryError` where it can't be kept."""
        committed = asyncio.get_running_loop().create_future()
        await self._share.rested()
        done = partial(_set, committed)
        self._share.run(self._history.append, self.record.number, steps, done, revisions, episodes)
        while not (await asyncio.wait((committed,), timeout=0.5))[0]:
            self.check_kept()
        self.commits.notify()

    def check_kept(self) -> None:
        """Raise `HistoryError` where nothing more of it can be kept."""
        trouble = self._history.failure_of(self.record.number)
        if trouble is not None:
            raise HistoryError(f"what was judged can't be kept: {trouble}")

    async def close(self, now: int, because: str, *, complete: bool) -> None:
        """Keep that the session is over, and how it stands. One that is not complete says so as its trouble.

        Unless what was told is settled, it stands by what is committed.
        """
        state = self.state
        if not self._settled:
            await self._history.flush()
            with contextlib.suppress(UnansweredError):
                state |= await _by_rows(self._history, self.record, state)
        state |= end_of(now, because) | {"continued_by": None, "clock_went_back": False}
        if not complete:
            state["trouble"] = f"incomplete: {because}"
        closed = asyncio.get_running_loop().create_future()
        self._history.close_session(self.record.number, now, state, partial(_set, closed))
        await closed

    def end(self) -> None:
        """Tell those who wait that it is closed."""
        self.commits.end()
        self._closed.set()

    async def closed_within(self, within: float) -> bool:
        """Wait so many seconds until it is closed; returns whether it is."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within):
                await self._closed.wait()
        return self._closed.is_set()


async def cut_off(record: SessionRecord, history: History, now: int) -> Document:
    """The state to close a session with whose recording was being judged when the server ended, by what is committed.

    Raises `UnansweredError`.
    """
    state = bare(record)
    state |= await _by_rows(history, record, state) | end_of(now, CUT_OFF)
    return state | {"trouble": f"incomplete: {CUT_OFF}", "continued_by": None, "clock_went_back": False}


async def _by_rows(history: History, record: SessionRecord, told: Document) -> Document:
    """What the rows tell of its state, and of its open episodes, which end with it; nothing where they can't be read.

    Raises `UnansweredError`.
    """
    try:
        found = await committed(history, record, told)
        if episodes := await left_open(history, record):
            history.append(record.number, [], _nothing, [], episodes)
        return found  # noqa: TRY300 -- it is of what may fail
    except UnansweredError:
        raise
    except HistoryError as error:
        log.warning("how a recording was judged can't be read", session=record.id, reason=str(error))
        return {}


def _nothing() -> None:
    """It is committed before the session is closed."""


def _set(closed: asyncio.Future[None]) -> None:
    if not closed.done():
        closed.set_result(None)
