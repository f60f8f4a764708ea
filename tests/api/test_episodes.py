"""Episodes over HTTP: of a session, over all sessions, and only those that a token covers."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

import httpx
import pytest

from oracle_server.edge.tokens import add
from tests.api.conftest import Asked
from tests.sessions.making import GUARD, Kept, attach, event

SECOND = 10**9
SLOW, FAST = 1, 9


@pytest.fixture
async def filled(asked: Asked) -> Asked:
    """Two sessions: one in which a violation goes on, and one with two that are over."""
    asked.registry._library.put("guard", GUARD)
    asked.registry._library.put("other", GUARD.replace("id: guard", "id: other"))
    for name, spec, speeds in (("s", "guard", (FAST, SLOW, FAST)), ("t", "other", (SLOW, FAST, SLOW))):
        live, monitor = await asked.registry.attach(attach(name, spec), Kept())
        for seq, speed in enumerate(speeds, 1):
            live.ingest(monitor, event(seq, speed=speed))
        live.ledger.write()
    await asked.registry._history.flush()
    return asked


async def items(asked: Asked, path: str, **query: Any) -> list[dict[str, Any]]:
    response = await asked.http.get(f"/api/v1/{path}", params=query)
    assert response.status_code == 200, response.text
    found: list[dict[str, Any]] = response.json()["items"]
    return found


async def test_a_sessions_episodes_are_told(filled: Asked) -> None:
    (episode,) = await items(filled, "sessions/s/episodes")
    assert (episode["session"], episode["property"], episode["first"], episode["count"]) == ("s", "slow", 1, 2)
    assert (episode["open"], episode["last"], episode["until"], episode["final"]) == (True, None, None, False)
    assert "slow does not hold at step 1" in episode["explanation"]


async def test_all_sessions_are_asked_at_once(filled: Asked) -> None:
    assert {e["session"] for e in await items(filled, "episodes")} == {"s", "t"}
    assert [e["session"] for e in await items(filled, "episodes", open=True)] == ["s"]
    assert [e["session"] for e in await items(filled, "episodes", open=False)] == ["t"]
    assert await items(filled, "episodes", property="none") == []


async def test_pages_go_on_where_the_last_one_ended(filled: Asked) -> None:
    first = (await filled.http.get("/api/v1/episodes", params={"limit": 1})).json()
    second = (await filled.http.get("/api/v1/episodes", params={"limit": 1, "after": first["next"]})).json()
    assert {page["items"][0]["session"] for page in (first, second)} == {"s", "t"}
    assert second["next"] is None


@pytest.mark.parametrize("query", ["after=7", "after=1:2:p", "limit=0", "limit=1001", "since=-1", "open=perhaps"])
async def test_what_cannot_be_meant_is_refused(filled: Asked, query: str) -> None:
    assert (await filled.http.get(f"/api/v1/episodes?{query}")).status_code == 422


async def test_of_a_session_that_is_not_known_there_are_none(filled: Asked) -> None:
    assert (await filled.http.get("/api/v1/sessions/nobody/episodes")).status_code == 404


async def test_once_a_session_is_closed_none_of_it_is_open(filled: Asked) -> None:
    assert (await filled.http.delete("/api/v1/sessions/s")).status_code == 200
    (episode,) = await items(filled, "sessions/s/episodes")
    assert (episode["open"], episode["last"]) == (False, 3)


@pytest.mark.parametrize(
    ("bound", "seen"),
    [
        ({"sessions": ["s"]}, {"s"}),
        ({"specs": ["other"]}, {"t"}),
        ({"specs": ["other"], "sessions": ["s"]}, set()),
        ({}, {"s", "t"}),
    ],
)
async def test_a_bound_token_sees_its_own_alone(
    filled: Asked, tmp_path: Path, bound: dict[str, list[str]], seen: set[str]
) -> None:
    headers = {"Authorization": f"Bearer {await asyncio.to_thread(_token, tmp_path, bound)}"}
    await filled.guarded._tokens.refreshed()
    response = await filled.http.get("/api/v1/episodes", headers=headers)
    assert {e["session"] for e in response.json()["items"]} == seen
    for name in ("s", "t"):
        status = (await filled.http.get(f"/api/v1/sessions/{name}/episodes", headers=headers)).status_code
        assert status == (200 if name in seen else 403)
    assert (await httpx_without(filled)).status_code == 401


async def test_a_bound_token_sees_the_runs_in_which_its_session_goes_on(asked: Asked, tmp_path: Path) -> None:
    asked.registry._library.put("guard", GUARD)
    long = "x" * 64
    mine, others = (
        ["s", "s.run2", "s.run13", long, f"{long[:59]}.run2"],
        ["s.runner", "s.run2x", "t.run2", "s.run2.run3"],
    )
    for name in mine + others:
        live, monitor = await asked.registry.attach(attach(name, "guard"), Kept())
        live.ingest(monitor, event(1, speed=FAST))
        live.ledger.write()
    await asked.registry._history.flush()
    headers = {"Authorization": f"Bearer {await asyncio.to_thread(_token, tmp_path, {'sessions': ['s', long]})}"}
    await asked.guarded._tokens.refreshed()

    async def seen(path: str) -> set[str]:
        found = (await asked.http.get(f"/api/v1/{path}", headers=headers)).json()["items"]
        return {one.get("session") or one["id"] for one in found}

    assert await seen("episodes") == await seen("sessions") == set(mine)


def _token(folder: Path, bound: dict[str, list[str]]) -> str:
    return add(folder / "no tokens", "reader", ["read"], **bound)


async def httpx_without(asked: Asked) -> httpx.Response:
    return await asked.http.get("/api/v1/episodes")
