"""A session that could not be restored, or of which nothing more can be kept, is seen and can be closed."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions.unrestored import Unrestored
from tests.api.conftest import Asked
from tests.sessions.making import GUARD, Kept, attach, event

REASON = "spec.yaml:2:1: streams: not a list\nspec.yaml:3:1: formula: no"


async def leave(asked: Asked) -> MemoryHistory:
    """Leave session `s` in the history, as one that could not be restored."""
    history = asked.registry._history
    assert isinstance(history, MemoryHistory)
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 201
    live = asked.registry.open.pop("s")
    asked.registry.unrestored["s"] = Unrestored(live.record, REASON)
    return history


async def test_its_state_says_why_and_the_list_shows_it(asked: Asked) -> None:
    await leave(asked)
    state = (await asked.http.get("/api/v1/sessions/s")).json()
    assert (state["id"], state["spec"], state["status"]) == ("s", "single", "unrestored")
    assert state["trouble"] == f"it could not be restored: {REASON}"
    assert (await asked.http.get("/api/v1/sessions")).json()["items"] == [state]
    assert (await asked.http.get("/api/v1/sessions/s/verdicts")).status_code == 200
    assert (await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})).status_code == 409
    assert "oracle_sessions_in_trouble 1.0" in (await asked.http.get("/metrics")).text


async def test_it_can_be_closed(asked: Asked) -> None:
    await leave(asked)
    answer = await asked.http.delete("/api/v1/sessions/s")
    assert (answer.status_code, answer.json()["status"]) == (200, "closed")
    assert answer.json()["trouble"] == f"it could not be restored: {REASON}"
    assert (await asked.http.get("/api/v1/sessions/s")).json() == answer.json()
    assert (await asked.http.get("/api/v1/sessions")).json()["items"] == [answer.json()]
    assert (await asked.http.delete("/api/v1/sessions/s")).json() == answer.json()
    assert "oracle_sessions_in_trouble 0.0" in (await asked.http.get("/metrics")).text


async def test_those_who_are_told_of_ends_are_told_once_that_it_is_closed(asked: Asked) -> None:
    await leave(asked)
    told = list[Any]()
    asked.registry._alarms = SimpleNamespace(wants=bool, send=told.append)
    for _ in range(2):
        assert (await asked.http.delete("/api/v1/sessions/s")).status_code == 200
    (alarm,) = told
    assert (alarm["alarm"], alarm["session"], alarm["because"]) == ("session_ended", "s", "by request")
    assert alarm["text"].startswith("session s is closed: by request; it could not be restored: spec.yaml:2:1: ")
    assert alarm["violations"] is None, "nobody knows them"


async def test_while_the_history_can_not_be_written_it_is_closed_later(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = await leave(asked)
    monkeypatch.setattr("oracle_server.api.sessions._CLOSE_WITHIN", 0.01)
    with monkeypatch.context() as stuck:
        stuck.setattr(history, "_commit", lambda: None)
        answer = await asked.http.delete("/api/v1/sessions/s")
        assert answer.status_code == 503
        assert "as soon as it can be" in answer.json()["detail"]
        assert (await asked.http.get("/api/v1/sessions/s")).json()["status"] == "unrestored"
    history._commit()
    await history.flush()
    assert (await asked.http.get("/api/v1/sessions/s")).json()["status"] == "closed"


async def test_a_session_that_can_not_be_kept_is_not_said_to_be_opened(
    asked: Asked, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = asked.registry._history
    assert isinstance(history, MemoryHistory)
    monkeypatch.setitem(history._failures, 1, "it is too large")
    answer = await asked.http.post("/api/v1/sessions", json={"spec": "single", "id": "s"})
    assert answer.status_code == 503
    assert "'s' can't be kept any more: it is too large; close it, and open another" in answer.json()["detail"]
    state = (await asked.http.get("/api/v1/sessions/s")).json()
    assert state["trouble"] == "nothing more of it can be kept: it is too large"
    assert "oracle_sessions_in_trouble 1.0" in (await asked.http.get("/metrics")).text


async def test_what_is_not_known_of_it_is_not_said_to_be_none(asked: Asked) -> None:
    await leave(asked)
    (listed,) = (await asked.http.get("/api/v1/sessions", params={"brief": True})).json()["items"]
    assert (listed["violations"], listed["outcome"], listed["steps"]) == (None, None, None)
    assert (await asked.http.delete("/api/v1/sessions/s")).json()["status"] == "closed"
    (listed,) = (await asked.http.get("/api/v1/sessions", params={"brief": True})).json()["items"]
    assert (listed["violations"], listed["status"]) == (None, "closed")


async def test_its_streams_tell_what_is_kept_and_not_that_it_is_closed(asked: Asked) -> None:
    history = asked.registry._history
    asked.registry._library.put("guard", GUARD)
    live, monitor = await asked.registry.attach(attach("s", "guard"), Kept())
    live.ingest(monitor, event(1, speed=9))
    live.ledger.write()
    await history.flush()
    asked.registry.unrestored["s"] = Unrestored(asked.registry.open.pop("s").record, REASON)
    path = "/api/v1/sessions/s"
    episodes = (await asked.http.get(f"{path}/episodes/stream")).text
    assert episodes.count("event: ") == episodes.count("event: begun") == 1
    assert (await asked.http.get(f"{path}/stream", params={"stream": "/go"})).status_code == 200
    verdicts = (await asked.http.get(f"{path}/stream")).text
    assert ("id: 1" in verdicts, "event: " in verdicts) == (True, False)
    assert (await asked.http.delete(path)).status_code == 200
    for stream in ("episodes/stream", "stream"):
        assert "event: closed" in (await asked.http.get(f"{path}/{stream}")).text
