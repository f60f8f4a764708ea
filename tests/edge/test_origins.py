"""Which `Host` and `Origin` are let in: however an allowed name or address is written, and no other."""

from __future__ import annotations

import pytest
from starlette.types import Message, Receive, Scope, Send

from oracle_server.edge.origins import Origins


async def status(host: str, origin: str | None = None, *, allowed: str = "", at: str | None = "192.0.2.1") -> int:
    """By which status a request is answered, at a server with this address."""
    told: list[Message] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def receive() -> Message:
        raise AssertionError("nothing is read before")

    async def send(message: Message) -> None:
        told.append(message)

    headers = [(b"host", host.encode()), *([(b"origin", origin.encode())] if origin is not None else [])]
    server = None if at is None else (at, 80)
    scope = {"type": "http", "method": "GET", "path": "/", "headers": headers, "server": server}
    await Origins(app, [allowed] if allowed else [])(scope, receive, send)
    return int(told[0]["status"])


@pytest.mark.parametrize(
    ("allowed", "host"),
    [
        ("Robot.local", "robot.LOCAL:8000"),
        ("https://robot.local:8000", "robot.local"),
        ("2001:DB8:0::7", "[2001:db8::7]:8000"),
        ("[2001:db8::7]:8000", "[2001:db8:0:0::7]"),
        ("fe80::7%eth0", "[fe80::7]"),
        ("203.0.113.9", "[::ffff:203.0.113.9]:1"),
    ],
)
async def test_an_allowed_host_is_let_in_however_it_is_written(allowed: str, host: str) -> None:
    assert await status(host, allowed=allowed) == 200
    assert await status(host) == 421


async def test_a_page_is_let_in_where_it_is_the_servers_own() -> None:
    assert await status("LOCALHOST:8000", "http://localhost:8000") == 200
    assert await status("localhost:8000", "http://localhost:8001") == 403
    assert await status("") == await status("", at=None) == 421, "where no address is known, none is its own"
