"""A file of tokens that can't be read for a while lets nobody in, and nobody gives up by it."""

from __future__ import annotations

import asyncio
import queue
import time
from pathlib import Path

import httpx
from oracle_adapter import Link, LinkError

from oracle_server.edge.tokens import add
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, problem


async def test_an_adapter_comes_back_once_the_file_can_be_read_again(start: Starts, tmp_path: Path) -> None:
    """As where an editor empties a file before it writes it: all adapters were told 401, and gave up for good."""
    file = tmp_path / "data" / "tokens.json"
    secret = add(file, "robot", ["admin"])
    server, errors = start(), queue.Queue[LinkError]()
    headers = {"Authorization": f"Bearer {secret}"}

    def ask() -> httpx.Response:
        return server.http.get("/api/v1/sessions", headers=headers)

    with Link(server.url, "m1", spec="single", session="s", token=secret, on_error=errors.put) as link:
        await asyncio.to_thread(link.wait_attached, PATIENCE)
        text = file.read_text()
        file.write_text("")
        assert "can't read its file of tokens" in problem(ask(), 503)["detail"]
        assert problem(server.http.get("/api/v1/sessions"), 503), "nor is it told who has none"
        while "503" not in str(error := await asyncio.to_thread(errors.get, timeout=PATIENCE)):
            assert not error.fatal, error
        file.write_text(text)
        assert link.send("/a", "topic", time.time_ns(), {"v": 1})
        await server.until(lambda: ask().json()["items"][0]["counters"]["steps"], lambda steps: steps == 1)
    assert server.said("the tokens can't be read: all requests are refused")
