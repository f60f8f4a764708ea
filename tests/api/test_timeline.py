"""A session by time over HTTP."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.api import timeline
from oracle_server.core.errors import UnpreparedError
from oracle_server.history.memory import MemoryHistory
from tests.api.conftest import Asked
from tests.sessions.making import GUARD, Kept, attach, event

PATH = "/api/v1/sessions/s/timeline"


@pytest.fixture
async def session(asked: Asked) -> None:
    """A session of three events, the second of which breaks its property."""
    live, monitor = await asked.registry.attach(attach("s", "single"), Kept())
    for seq, value in ((1, 3), (2, 30), (3, 4)):
        live.ingest(monitor, event(seq, "/a", v=value))
    live.ledger.write()
    await asked.registry.flush()


@pytest.mark.usefixtures("session")
async def test_all_of_a_session_is_told_at_once(asked: Asked) -> None:
    answer = await asked.http.get(PATH, params={"buckets": 1, "signal": ["/a:v"]})
    assert answer.status_code == 200
    found = answer.json()
    assert found["first"] <= found["last"] < found["since"] + found["width"]
    assert (found["buckets"], found["position"], found["lanes"]) == (1, 3, {"a_is_small": "f"})
    assert (found["violations"], found["degraded"]) == ({"a_is_small": [1]}, {"a_is_small": "0"})
    assert (found["steps"], found["late"], found["asked"], found["denied"]) == ([3], [0], [0], [0])
    assert found["streams"] == {"/a": {"count": [3], "lost": [0]}}
    assert found["signals"]["/a:v"] == {
        "count": [3], "min": [3], "max": [30], "mean": [37 / 3], "text": [None], "several": [False],
    }  # fmt: skip


@pytest.mark.usefixtures("session")
@pytest.mark.parametrize("path", [PATH, f"{PATH}/stream?width=1000"])
async def test_a_signal_that_there_is_not_is_refused_with_the_nearest(asked: Asked, path: str) -> None:
    asked.registry._library.put("guard", GUARD)
    await asked.registry.attach(attach("t", "guard"), Kept())
    path = path.replace("/s/", "/t/")
    for signal, said in (
        ("/go:sped", "query.signal: /go has no signal `sped`; did you mean `speed`?"),
        ("/go:x", "query.signal: /go has no signal `x`; there are speed"),
        ("/og:speed", "query.signal: guard has no stream `/og`; did you mean `/go`?"),
    ):
        answer = await asked.http.get(path, params={"signal": signal} | ({"width": 1000} if "width" in path else {}))
        assert (answer.status_code, answer.json()["detail"]) == (422, said)


@pytest.mark.usefixtures("session")
async def test_only_the_parts_that_are_asked_for_are_told(asked: Asked) -> None:
    found = (await asked.http.get(PATH, params={"part": ["lanes", "steps"]})).json()
    assert {*found} == {
        "since", "width", "buckets", "position", "first", "last", "lanes", "degraded", "steps", "late", "signals",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"buckets": 2001}, "query.buckets"),
        ({"since": 2, "until": 1}, "query.since: it is after `until`"),
        ({"signal": "speed"}, "query.signal.0"),
        ({"signal": [f"/a:{i}" for i in range(9)]}, "query.signal"),
        ({"part": "lane"}, "query.part.0"),
    ],
)
@pytest.mark.usefixtures("session")
async def test_what_cannot_be_asked_is_said(asked: Asked, wrong: dict[str, Any], said: str) -> None:
    answer = await asked.http.get(PATH, params=wrong)
    assert (answer.status_code, answer.json()["detail"][: len(said)]) == (422, said)


@pytest.mark.usefixtures("session")
async def test_an_answer_that_is_too_long_is_refused(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timeline, "MOST_BYTES", 100)
    answer = await asked.http.get(PATH)
    assert answer.status_code == 422
    assert "ask for fewer buckets, parts or signals" in answer.json()["detail"]


@pytest.mark.usefixtures("session")
async def test_one_that_is_not_ready_says_when_to_ask_again(asked: Asked, monkeypatch: pytest.MonkeyPatch) -> None:
    async def unready(*_: object) -> bytes:
        raise UnpreparedError("half of it is made")

    monkeypatch.setattr(MemoryHistory, "timeline", unready)
    answer = await asked.http.get(PATH)
    assert (answer.status_code, answer.headers["Retry-After"]) == (503, "60")
    assert answer.json()["detail"] == "half of it is made"


async def test_a_session_that_nobody_knows_is_not_told(asked: Asked) -> None:
    assert (await asked.http.get(PATH)).status_code == 404
