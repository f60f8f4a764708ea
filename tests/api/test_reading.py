"""Clients that read much keep neither each other nor monitors waiting."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import httpx
import pytest

from oracle_server.core.records import VerdictRecord
from oracle_server.edge.access import Access
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.tokens import Tokens, add
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.query import Query
from oracle_server.history.readers import THREADS, reading_for
from tests.api.conftest import Asked
from tests.processes import PATIENCE
from tests.sessions.making import Kept, attach, event

VERDICTS = "/api/v1/sessions/s/verdicts"


class Held:
    """Makes each page take until it is let go, where the client asked for the outcome `false`."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun, self.going = threading.Semaphore(0), threading.Event()

        def matches(query: Query, _: VerdictRecord) -> bool:
            if query.outcomes:
                self.begun.release()
                assert self.going.wait(PATIENCE)
            return True

        monkeypatch.setattr(Query, "matches", matches)

    async def until_begun(self) -> None:
        assert await asyncio.to_thread(self.begun.acquire, timeout=PATIENCE)


@pytest.fixture
async def held(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> AsyncIterator[Held]:
    """Pages that are held, of a session with one event."""
    holding = Held(monkeypatch)
    async with asyncio.timeout(PATIENCE):
        live, monitor = await asked.registry.attach(attach("s", "single"), Kept())
        live.ingest(monitor, event(1, "/a", id=1))
        live.ledger.write()
        await asked.registry.flush()
        try:
            yield holding
        finally:
            holding.going.set()


def client(asked: Asked, address: str, **headers: str) -> httpx.AsyncClient:
    transport = httpx.ASGITransport(asked.guarded, raise_app_exceptions=False, client=(address, 1))
    return httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1", headers=headers)


@asynccontextmanager
async def reading(held: Held, http: httpx.AsyncClient, count: int = 20) -> AsyncIterator[None]:
    """Within this, a client waits for so many pages, of which one is read at least."""
    wanted = {"outcome": ["true", "false", "currently_true", "currently_false", "unknown"]}
    asking = [asyncio.create_task(http.get(VERDICTS, params=wanted)) for _ in range(count)]
    await held.until_begun()
    try:
        yield
        held.going.set()
        assert [answer.status_code for answer in await asyncio.gather(*asking)] == [200] * count
    finally:
        for task in asking:
            task.cancel()


async def test_who_reads_much_keeps_no_other_address_from_reading(asked: Asked, held: Held) -> None:
    async with client(asked, "10.0.0.1") as greedy, client(asked, "10.0.0.2") as other, reading(held, greedy):
        answer = await other.get(VERDICTS)
        assert answer.status_code == 200
        assert answer.json()["items"]


async def test_clients_are_told_apart_by_their_tokens(asked: Asked, held: Held, tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    one, two = (f"Bearer {add(file, name, ['read'])}" for name in ("one", "two"))
    asked.guarded = Access(asked.app, Tokens(file), RouteScopes(asked.app.routes))
    same = "10.0.0.1"
    async with (
        client(asked, same, Authorization=one) as greedy,
        client(asked, same, Authorization=two) as other,
        reading(held, greedy),
    ):
        assert (await other.get(VERDICTS)).status_code == 200


async def test_no_attach_waits_for_readers(asked: Asked, held: Held) -> None:
    history = asked.registry._history
    assert isinstance(history, MemoryHistory)
    waiting: list[asyncio.Future[bool]] = []
    for i in range(THREADS):
        with reading_for(f"client {i}"):
            waiting += [asyncio.ensure_future(history.in_thread(held.going.wait)) for _ in range(10)]
    live, _ = await asked.registry.attach(attach("another", "single"), Kept())
    assert live.id == "another"
    wanted = {"spec": "single", "id": "third"}
    assert (await asked.http.post("/api/v1/sessions", json=wanted)).status_code == 201
    assert not any(one.done() for one in waiting)


async def test_who_leaves_frees_the_place(asked: Asked, held: Held) -> None:
    async with client(asked, "10.0.0.1") as http:
        asking = [asyncio.create_task(http.get(VERDICTS, params={"outcome": "unknown"})) for _ in range(5)]
        asking += [asyncio.create_task(http.get(VERDICTS, params={"outcome": "currently_true"})) for _ in range(5)]
        await held.until_begun()
        for task in asking:
            task.cancel()
        await asyncio.gather(*asking, return_exceptions=True)
        history = asked.registry._history
        assert isinstance(history, MemoryHistory)
        assert history._readers.waiting == 0
        held.going.set()
        assert (await http.get(VERDICTS)).status_code == 200
