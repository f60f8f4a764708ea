"""Downloads of a session: what can't be read is an error, and no answer that breaks off."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator

import pytest
from starlette.types import Message

from oracle_server.core.errors import HistoryError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import StoredStep
from tests.api.conftest import Asked
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event


@pytest.mark.parametrize(("what", "read"), [("trace", "by_arrival"), ("changes", "steps")])
async def test_a_history_that_cannot_be_read_is_told(
    asked: Asked, monkeypatch: pytest.MonkeyPatch, what: str, read: str
) -> None:
    """It was answered by 200 and an empty body, as a session without a step is."""

    async def unread(*pages: list[StoredStep]) -> AsyncGenerator[list[StoredStep], None]:
        for page in pages[:0]:
            yield page
        raise HistoryError("the disk fails")

    await asked.registry.create("single", "s")
    await asked.registry.flush()
    assert (await asked.http.get(f"/api/v1/sessions/s/{what}")).status_code == 200
    monkeypatch.setattr(MemoryHistory, read, unread)
    answer = await asked.http.get(f"/api/v1/sessions/s/{what}")
    assert (answer.status_code, answer.json()["detail"]) == (503, "the disk fails")


@pytest.mark.parametrize("what", ["trace", "changes"])
async def test_all_pages_are_sent_once(asked: Asked, what: str) -> None:
    live, monitor = await asked.registry.attach(attach("s", "single"), Kept())
    for i in range(1, 2502):
        live.ingest(monitor, event(i, "/a", id=1, v=20 * (i % 2)))
    live.ledger.write()
    await asked.registry.flush()
    lines = (await asked.http.get(f"/api/v1/sessions/s/{what}")).text.splitlines()
    assert len(lines) == len({*lines}) == 2501


async def test_long_lines_are_sent_a_few_at_once(asked: Asked) -> None:
    """What is sent at once is copied on the event loop: a hundred lines of a megabyte kept all decisions waiting."""
    live, monitor = await asked.registry.attach(attach("s", "texts"), Kept())
    for i in range(1, 31):
        live.ingest(monitor, event(i, "/a", name=f"{i}" + "x" * 100_000, list=[]))
    live.ledger.write()
    await asked.registry.flush()
    pieces: list[bytes] = []

    async def receive() -> Message:
        await asyncio.Event().wait()
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        pieces.append(message.get("body", b""))

    path = "/api/v1/sessions/s/trace"
    named = {"type": "http", "http_version": "1.1", "method": "GET", "path": path}
    scope = {**named, "headers": [], "query_string": b"", "state": {}}
    async with asyncio.timeout(PATIENCE):
        await asked.guarded(scope, receive, send)
    assert b"".join(pieces).count(b"\n") == 30
    assert max(map(len, pieces)) < 10**6
