"""A token that is bound is told nothing of what others open while it attaches."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any, cast

import pytest
from starlette.websockets import WebSocket

from oracle_server.attach.connection import Connection
from oracle_server.edge.tokens import Grant
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.registry import Registry
from tests.attach.test_resting import Socket
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, attach, registry

SECRET = GUARD.replace("id: guard", "id: secret")


class Outdated(MemoryHistory):
    """A history that answers a look for a session by what it knew before it was given time to answer."""

    def __init__(self) -> None:
        super().__init__()
        self.looking, self.going = asyncio.Event(), asyncio.Event()

    async def session(self, name: str | int) -> SessionRecord | None:
        found = await super().session(name)
        if not self.looking.is_set():
            self.looking.set()
            await self.going.wait()
        return found


@pytest.fixture
async def history() -> AsyncIterator[Outdated]:
    made = Outdated()
    yield made
    made.close()


@pytest.fixture
async def sessions(history: Outdated, tmp_path: Path) -> Registry:
    return registry(history, tmp_path, GUARD, SECRET)


async def told(sessions: Registry, history: Outdated, grant: Grant) -> dict[str, Any]:
    """What a monitor by `guard` is told where another one opens the session by `secret` while it is looked for."""
    socket = Socket()
    socket.state = type("State", (), {"grant": grant})()
    serving = asyncio.create_task(Connection(cast("WebSocket", socket), sessions).serve())
    socket.says({"type": "attach", "monitor": "m", "instance": "i", "session": "s", "spec": "guard"})
    async with asyncio.timeout(PATIENCE):
        await history.looking.wait()
        await sessions.attach(attach("s", "secret", "other"), Kept())
        history.going.set()
        (error,) = await socket.hears("error")
        await serving
    return error


async def test_it_is_not_told_by_which_spec_another_has_opened_the_session(
    sessions: Registry, history: Outdated
) -> None:
    error = await told(sessions, history, Grant(frozenset({"submit"}), specs=frozenset({"guard"})))
    assert error["code"] == "forbidden"
    assert "secret" not in str(error)


async def test_who_may_know_both_specs_is_told(sessions: Registry, history: Outdated) -> None:
    error = await told(sessions, history, Grant(frozenset({"submit"}), specs=frozenset({"guard", "secret"})))
    assert error["code"] == "spec_mismatch"
    assert "judges by 'secret', not by 'guard'" in error["message"]
