"""What is answered where a request can't be."""

from __future__ import annotations

import httpx
import pytest
from fastapi import FastAPI

from oracle_server.edge.problems import install


@pytest.mark.parametrize(
    ("error", "status", "told"),
    [
        (RuntimeError("can't start new thread"), 503, "more threads are needed than there are"),
        (MemoryError(), 503, "more memory is needed than there is"),
        (RuntimeError("can't be"), 500, "the server failed to answer; see its log"),
        (RecursionError("can't be"), 500, "the server failed to answer; see its log"),
    ],
)
async def test_what_the_system_has_too_little_of_is_told_and_is_no_defect(
    error: Exception, status: int, told: str
) -> None:
    app = FastAPI()
    install(app)

    @app.get("/")
    async def fails() -> None:
        raise error

    transport = httpx.ASGITransport(app, raise_app_exceptions=False)
    async with httpx.AsyncClient(transport=transport, base_url="http://server") as client:
        answer = await client.get("/")
    assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")
    assert answer.json()["detail"].startswith(told)
