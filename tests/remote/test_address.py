"""An oracle, or who answers for its name, can't lead the server to another place."""

from __future__ import annotations

import asyncio
import socket
from collections.abc import AsyncIterator
from http import HTTPStatus
from typing import Any

import pytest
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import InvalidStatus
from websockets.http11 import Request, Response

from oracle_server.remote.address import UnreachableError, connected


class Place:
    """A server that notes who comes, and sends them on to `target` where there is one."""

    def __init__(self) -> None:
        self.target: str | None = None
        self.came: list[str] = []

    def answer(self, _: ServerConnection, request: Request) -> Response | None:
        self.came.append(request.headers["Host"])
        if self.target is None:
            return None
        return Response(HTTPStatus.FOUND.value, "Found", Headers(Location=self.target), b"")


async def wait(connection: ServerConnection) -> None:
    await connection.wait_closed()


@pytest.fixture
async def places() -> AsyncIterator[list[tuple[Place, str]]]:
    made: list[tuple[Place, str]] = []
    servers: list[Server] = []
    for place in (Place(), Place()):
        server = await serve(wait, "127.0.0.1", 0, process_request=place.answer)
        servers.append(server)
        made.append((place, f"ws://127.0.0.1:{next(iter(server.sockets)).getsockname()[1]}/"))
    yield made
    for server in servers:
        server.close()
        await server.wait_closed()


async def test_no_redirect_is_followed(places: list[tuple[Place, str]]) -> None:
    (first, url), (other, elsewhere) = places
    for target in (elsewhere, "/other", url + "other"):
        first.target = target
        with pytest.raises(InvalidStatus, match="302"):
            await connected(url)
    assert len(first.came) == 3
    assert other.came == []
    first.target = None
    await (await connected(url)).close()


def resolve(monkeypatch: pytest.MonkeyPatch, *addresses: str) -> None:
    """Let every name stand for these addresses."""

    async def getaddrinfo(_: object, __: object, port: int, **___: Any) -> list[Any]:
        return [(socket.AF_INET, socket.SOCK_STREAM, 6, "", (address, port)) for address in addresses]

    monkeypatch.setattr(asyncio.get_running_loop().__class__, "getaddrinfo", getaddrinfo)


@pytest.mark.parametrize("address", ["127.0.0.1", "169.254.169.254", "0.0.0.0", "::1", "fe80::1%1", "::ffff:127.0.0.1"])
async def test_a_name_that_stands_for_this_machine_or_no_machine_is_refused(
    monkeypatch: pytest.MonkeyPatch, places: list[tuple[Place, str]], address: str
) -> None:
    (place, url), _ = places
    resolve(monkeypatch, "192.0.2.1", address)
    with pytest.raises(UnreachableError, match="its name stands for"):
        await connected(url.replace("127.0.0.1", "oracle.example"))
    assert place.came == []


@pytest.mark.parametrize("name", ["localhost", "oracle.localhost", "LOCALHOST.", socket.gethostname()])
async def test_a_name_of_this_machine_may_stand_for_it(
    monkeypatch: pytest.MonkeyPatch, places: list[tuple[Place, str]], name: str
) -> None:
    (place, url), _ = places
    resolve(monkeypatch, "127.0.0.1")
    await (await connected(url.replace("127.0.0.1", name))).close()
    assert len(place.came) == 1
