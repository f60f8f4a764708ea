"""How a server leaves its sessions, and who is let into none: it stops, only reads, or another one may have them."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.ledger import Ledger
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.sessions.registry import Registry
from oracle_server.wire.errors import WireError
from tests.processes import PATIENCE
from tests.sessions.making import Kept, Standing, attach, event, registry

HELD = """
id: held
ordering: {max_delay: 1s}
streams:
  - {topic: /a, signals: {v: msg.v}}
  - {topic: /b, signals: {v: msg.v}}
properties:
  - {id: small, formula: 'not {v > 20}'}
"""


class Known(MemoryHistory):
    """A history that may only be read, or that another server may have."""

    may_only_read: str | None = None
    is_adrift = False

    @property
    def read_only(self) -> str | None:
        return self.may_only_read

    @property
    def adrift(self) -> bool:
        return self.is_adrift


@pytest.fixture
def history() -> Iterator[Known]:
    made = Known()
    yield made
    made.close()


@pytest.fixture
async def sessions(history: Known, tmp_path: Path) -> AsyncIterator[Registry]:
    async with asyncio.timeout(PATIENCE):
        yield registry(history, tmp_path, HELD, clock=Standing())


async def holding(sessions: Registry, name: str) -> tuple[LiveSession, Monitor, Kept]:
    """A session that holds an event, which waits for another stream's."""
    outbox = Kept()
    live, monitor = await sessions.attach(attach(name, "held"), outbox)
    live.ingest(monitor, event(1, "/a", v=1))
    return live, monitor, outbox


async def judged(history: Known, live: LiveSession) -> int:
    """How many events the history has of a session."""
    return len([stored async for page in history.steps(live.number, 0) for stored in page])


async def refused(sessions: Registry) -> str:
    """By which code who attaches to a session that is open is sent away for good."""
    with pytest.raises(WireError) as told:
        await sessions.attach(attach("one", "held", monitor="late"), Kept())
    assert told.value.fatal
    return told.value.code


async def test_nobody_is_let_into_what_only_is_read_or_may_be_elsewhere(history: Known, sessions: Registry) -> None:
    live, _, outbox = await holding(sessions, "one")
    history.may_only_read = "it is read here"
    assert await refused(sessions) == "read_only"
    history.may_only_read, history.is_adrift = None, True
    assert await refused(sessions) == "history_unavailable"
    await sessions.shut_down()
    assert [frame["code"] for frame in outbox.frames if frame["type"] == "error"] == ["shutting_down"]
    assert await judged(history, live) == 0, "that is for the server that has the session"


async def test_all_that_is_held_is_judged_at_the_end_but_for_a_session_that_fails_at_it(
    history: Known, sessions: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    failing, _, told = await holding(sessions, "one")
    other, _, _ = await holding(sessions, "two")
    close = LiveSession.close

    def fail(self: LiveSession) -> None:
        if self is failing:
            raise AssertionError("it can't be left")
        close(self)

    monkeypatch.setattr(LiveSession, "close", fail)
    await sessions.shut_down()
    assert [await judged(history, live) for live in (failing, other)] == [0, 1]
    assert await history.snapshot(failing.number) is None
    assert await history.snapshot(other.number) is not None
    assert [frame["code"] for frame in told.frames if frame["type"] == "error"] == ["shutting_down"]
    assert await refused(sessions) == "shutting_down"


async def test_others_are_served_between_two_sessions_that_are_left(
    history: Known, sessions: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Thousands that were left at once kept the last ones' decisions waiting for seconds."""
    for name in ("one", "two", "three"):
        await holding(sessions, name)
    turns, at = 0, dict[str, list[int]](close=[], save=[])

    async def count() -> None:
        nonlocal turns
        while True:
            turns += 1
            await asyncio.sleep(0)

    def noting(name: str, work: Callable[[Any], None]) -> Callable[[Any], None]:
        def noted(self: Any) -> None:
            at[name].append(turns)
            work(self)

        return noted

    monkeypatch.setattr(LiveSession, "close", noting("close", LiveSession.close))
    monkeypatch.setattr(Ledger, "save", noting("save", Ledger.save))
    counting = asyncio.create_task(count())
    await sessions.shut_down()
    counting.cancel()
    assert all(len(turns) == len({*turns}) == 3 for turns in at.values()), at
