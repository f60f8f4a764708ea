"""Explanations in turn: how many may be waited for, and what becomes of those that nobody waits for any more."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Coroutine
from typing import Any

import httpx
import pytest
from fastapi import Request

from oracle_server.api import explaining
from oracle_server.api.explaining import MOST, SHARE
from oracle_server.api.leaving import unless_left
from tests.api.conftest import Asked
from tests.processes import PATIENCE


class Blocked:
    """Takes the place of what explains: each explanation waits until it is allowed, or given up."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.begun: list[int] = []
        self.ended: list[int] = []
        self.allowed = asyncio.Event()
        self.at_once = 0
        self._begins = asyncio.Event()
        self._taken = asyncio.Semaphore(0)
        monkeypatch.setattr(explaining, "explained", self)
        monkeypatch.setattr(explaining, "unless_left", self._take)

    async def _take(self, request: Request, answer: Coroutine[Any, Any, Any]) -> Any:
        self._taken.release()
        return await unless_left(request, answer)

    async def until_taken(self, count: int) -> None:
        """Wait until so many are waited for, and one of them is begun."""
        async with asyncio.timeout(PATIENCE):
            for _ in range(count):
                await self._taken.acquire()
            await self._begins.wait()

    async def __call__(self, _: object, __: int, n: int, ___: str) -> dict[str, Any]:
        self.begun.append(n)
        self._begins.set()
        self.at_once = max(self.at_once, len(self.begun) - len(self.ended))
        try:
            await self.allowed.wait()
        finally:
            self.ended.append(n)
        return {"n": n}


@contextlib.asynccontextmanager
async def waiting(
    asked: Asked, numbers: range, address: str = "127.0.0.1"
) -> AsyncIterator[list[asyncio.Task[httpx.Response]]]:
    ask = asked.at(address).get
    tasks = [asyncio.create_task(ask(f"/api/v1/sessions/s/verdicts/{n}/explanation")) for n in numbers]
    try:
        yield tasks
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.wait(tasks)


async def test_one_is_computed_at_a_time_and_so_many_wait(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = Blocked(monkeypatch)
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
    async with waiting(asked, range(1, SHARE + 1)) as tasks:
        await blocked.until_taken(SHARE)
        assert (await asked.http.get("/api/v1/sessions/s/verdicts/99/parts")).status_code == 503
        refused = await asked.http.get("/api/v1/sessions/s/verdicts/99/explanation")
        assert refused.status_code == 503
        assert int(refused.headers["Retry-After"]) > 0
        assert refused.json()["detail"].startswith(f"{SHARE} explanations for you")
        blocked.allowed.set()
        answers = [(await task).json()["n"] for task in tasks]
    assert answers == blocked.begun == list(range(1, SHARE + 1))
    assert blocked.at_once == 1


async def test_who_asks_for_many_keeps_nobody_from_theirs(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = Blocked(monkeypatch)
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
    async with waiting(asked, range(1, SHARE + 1)) as greedy:
        await blocked.until_taken(SHARE)
        async with waiting(asked, range(100, 100 + MOST - SHARE), "10.0.0.2") as other:
            await blocked.until_taken(MOST - SHARE)
            third = await asked.at("10.0.0.3").get("/api/v1/sessions/s/verdicts/99/explanation")
            assert (third.status_code, third.json()["detail"].split()[1]) == (503, "explanations")
            greedy[-1].cancel()
            await asyncio.wait([greedy[-1]])
            blocked.allowed.set()
            assert [(await task).json()["n"] for task in other] == list(range(100, 100 + MOST - SHARE))
    assert blocked.begun[:6] == [1, 2, 100, 3, 101, 4]
    assert SHARE not in blocked.begun
    assert blocked.at_once == 1


async def test_who_leaves_makes_room_for_others(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    blocked = Blocked(monkeypatch)
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
    async with waiting(asked, range(1, SHARE + 1)):
        await blocked.until_taken(SHARE)
    assert blocked.begun == blocked.ended == [1], "what only waited was never begun"
    blocked.allowed.set()
    answers = [await asked.http.get(f"/api/v1/sessions/s/verdicts/{n}/explanation") for n in range(20, 20 + SHARE)]
    assert [answer.json()["n"] for answer in answers] == list(range(20, 20 + SHARE))
