"""Who comes while a session is closed, or the server stops: the history is locked, so that this takes its time."""

from __future__ import annotations

import signal
import socket
from contextlib import AsyncExitStack

import httpx
import pytest

from tests.whole.client import attached, connected, make_attach, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, problem
from tests.whole.test_disk import locked
from tests.whole.test_simulated import refused, sim_clock


async def until_ready(server: Server, status: int) -> None:
    """Wait until the server says whether it can write its history."""
    await server.until(lambda: server.http.get("/readyz").status_code, lambda found: found == status)


async def test_a_session_that_ends_names_the_next_to_who_comes_meanwhile(start: Starts) -> None:
    server = start()
    async with (
        attached(server, "m1", session="s", spec="pair", streams=["/a"], clock="sim") as first,
        AsyncExitStack() as connections,
    ):
        with locked(server):
            await first.send(make_event(1, stamp=8 * 10**9), sim_clock(9 * 10**9), sim_clock(10**9))
            await until_ready(server, 503)
            second = await connections.enter_async_context(connected(server))
            await second.send(make_attach("m2", session="s", clock="sim"))
        assert await refused(first) == ("session_ended", "s.run2")
        assert await refused(second) == ("session_ended", "s.run2")


async def test_a_server_that_stops_lets_nobody_in_and_sends_nobody_away_for_good(start: Starts) -> None:
    server = start()
    async with attached(server, "m1", session="s", spec="single") as first:
        with locked(server), httpx.Client(base_url=server.url, timeout=PATIENCE, trust_env=False) as http:
            await first.send(make_event(1, data={"v": 1}))
            await until_ready(server, 503)
            async with connected(server) as second:
                assert http.get("/healthz").status_code == 200
                server.process.send(signal.SIGTERM)
                server.said("stopping")
                host, port = server.url.removeprefix("http://").split(":")
                with pytest.raises(ConnectionRefusedError):
                    socket.create_connection((host, int(port)), PATIENCE).close()
                body = problem(http.post("/api/v1/sessions", json={"spec": "single", "id": "late"}), 503)
                assert "the server stops" in body["detail"]
                await second.send(make_attach("m2", session="later", spec="single"))
                for monitor in (first, second):
                    frames, code = await monitor.closed()
                    assert ([f.get("code") for f in frames], code) == (["shutting_down"], 1012)
    assert server.process.wait() == 0
    assert [s["id"] for s in start().get("sessions")["items"]] == ["s"]
