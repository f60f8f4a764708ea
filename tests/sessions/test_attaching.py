"""Monitors that attach at once to a session that is not there yet: each joins it, however slow the history is."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path
from typing import Any

import pytest

from oracle_server.core.session import Session
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord
from oracle_server.sessions import opening
from oracle_server.sessions.shares import Shares
from tests.sessions.making import GUARD, Kept, attach, registry


class Slow(MemoryHistory):
    """A history in which the first look for a session takes so long that another one commits it meanwhile."""

    def __init__(self) -> None:
        super().__init__()
        self.looking, self.going = asyncio.Event(), asyncio.Event()

    async def session(self, name: str | int) -> SessionRecord | None:
        if not self.looking.is_set():
            self.looking.set()
            await self.going.wait()
        return await super().session(name)


async def test_a_monitor_joins_the_session_that_another_opens_while_it_is_looked_for(tmp_path: Path) -> None:
    history = Slow()
    sessions = registry(history, tmp_path, GUARD)
    first = asyncio.create_task(sessions.attach(attach("s", "guard", "one"), Kept()))
    await history.looking.wait()
    live, _ = await sessions.attach(attach("s", "guard", "two"), Kept())
    await history.flush()
    history.going.set()
    joined, monitor = await first
    assert joined is live
    assert monitor.name == "one"


async def test_others_rest_for_a_session_while_it_has_monitors(tmp_path: Path) -> None:
    shares = Shares(lambda: 0.0, lambda: 0.0)
    sessions = registry(MemoryHistory(), tmp_path, GUARD, shares=shares)
    one, first = await sessions.attach(attach("one", "guard", "a"), Kept())
    _, second = await sessions.attach(attach("one", "guard", "b"), Kept())
    other, _ = await sessions.attach(attach("other", "guard"), Kept())

    def resting_for() -> int:
        one.share.run(lambda: None)  # as it is when it is written, too
        return shares.others(other.share, 0.0)

    assert resting_for() == 1
    one.detach(first)
    assert resting_for() == 1
    one.detach(second)
    assert resting_for() == 0
    await sessions.attach(attach("one", "guard", "a"), Kept())
    assert resting_for() == 1


async def test_a_session_is_made_beside_the_event_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[threading.Thread] = []

    class Noted(Session):
        def __init__(self, *given: Any, **named: Any) -> None:
            made.append(threading.current_thread())
            super().__init__(*given, **named)

    monkeypatch.setattr(opening, "Session", Noted)
    await registry(MemoryHistory(), tmp_path, GUARD).attach(attach("s", "guard"), Kept())
    assert len(made) == 1
    assert made[0] is not threading.current_thread(), "of a thousand properties it takes a quarter of a second"
