"""Recordings that are cancelled before all of them has come."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import pytest

from tests.api.conftest import Asked
from tests.processes import PATIENCE

LINE = b'{"stream": "/a", "stamp": 1, "data": {"v": 1}}\n'


@pytest.mark.parametrize("ends", [True, False], ids=["the rest comes", "no more comes"])
async def test_one_that_is_cancelled_while_it_is_received_is_not_judged(
    ends: bool, asked: Asked, tmp_path: Path
) -> None:
    begun, going = asyncio.Event(), asyncio.Event()

    async def body() -> AsyncIterator[bytes]:
        yield LINE
        begun.set()
        await going.wait()
        yield LINE

    query = {"spec": "single", "session": "s"}
    async with asyncio.timeout(PATIENCE):
        sending = asyncio.create_task(asked.http.post("/api/v1/recordings", params=query, content=body()))
        await begun.wait()
        (one,) = (await asked.http.get("/api/v1/recordings")).json()["items"]
        assert one["state"] == "receiving"
        if ends:
            going.set()
        gone = await asked.http.delete(f"/api/v1/recordings/{one['id']}")
        assert (gone.status_code, gone.json()["state"]) == (200, "cancelled")
        answer = await sending
    assert (answer.status_code, answer.json()["detail"]) == (409, "the recording is not judged: it was cancelled")
    (one,) = (await asked.http.get("/api/v1/recordings")).json()["items"]
    assert (one["state"], one["error"], one["session"]) == ("cancelled", "it was cancelled", None)
    assert (await asked.http.get("/api/v1/sessions/s")).status_code == 404
    assert not [*(tmp_path / "recordings").glob("*")]
    going.set()
    again = await asked.http.post("/api/v1/recordings", params=query, content=LINE)
    assert again.status_code == 202, "its sender's place is free"
