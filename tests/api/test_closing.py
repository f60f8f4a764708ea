"""A session that can't be closed: it says so, and goes on."""

from __future__ import annotations

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions import opening
from oracle_server.sessions.live import LiveSession
from tests.api.conftest import Asked


async def test_a_session_that_fails_to_close_is_an_error_and_stays_open(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201

    async def fail(_: LiveSession) -> None:
        raise RuntimeError("a bug")

    with monkeypatch.context() as broken:
        broken.setattr(LiveSession, "settle", fail)
        for _ in range(2):
            answer = await asked.http.delete("/api/v1/sessions/s")
            assert answer.status_code == 500
            assert answer.headers["content-type"] == "application/problem+json"
            assert "session 's' could not be closed" in answer.json()["detail"]
    assert (await asked.http.get("/api/v1/sessions/s")).json()["status"] == "open"
    answer = await asked.http.delete("/api/v1/sessions/s")
    assert (answer.status_code, answer.json()["status"]) == (200, "closed")


async def test_a_session_can_be_neither_opened_nor_closed_once_the_server_stops(asked: Asked) -> None:
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
    await asked.registry.shut_down()
    for answer in (
        await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "late"}),
        await asked.http.delete("/api/v1/sessions/s"),
    ):
        assert answer.status_code == 503
        assert "the server stops" in answer.json()["detail"]
    assert [s["id"] for s in (await asked.http.get("/api/v1/sessions")).json()["items"]] == ["s"]


async def test_no_end_of_sessions_is_opened_while_the_history_can_not_be_written(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = asked.registry._history
    assert isinstance(history, MemoryHistory)
    history.failure = "no space left on device"
    monkeypatch.setattr(opening, "_UNWRITTEN", -1)
    answer = await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})
    assert answer.status_code == 503
    assert "no space left" in answer.json()["detail"]
    assert not asked.registry.open
    history.failure = None
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
