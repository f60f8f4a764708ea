"""Who may talk to the server: no page of another origin, and no one who calls it by another name."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator

import httpx
from websockets.asyncio.client import connect

from tests.whole.conftest import Starts
from tests.whole.harness import PATIENCE, Server, problem

HANDSHAKE = (
    "GET /api/v1/attach HTTP/1.1\r\nHost: {host}\r\n{origin}Upgrade: websocket\r\nConnection: Upgrade\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


def foreign(server: Server) -> Iterator[tuple[dict[str, str], int]]:
    port = server.url.rsplit(":", 1)[1]
    for host in ("example.org", f"example.org:{port}", "127.0.0.1.example.org", "169.254.1.1", "localhost.", "[", ""):
        yield {"Host": host}, 421
    for origin in (
        "null",
        "http://example.org",
        f"http://localhost:{port}",
        "http://127.0.0.1:1",
        "file://",
        "",
        "http://[",
    ):
        yield {"Origin": origin}, 403


async def test_foreign_hosts_and_origins_are_refused(server: Server) -> None:
    for headers, status in foreign(server):
        for path in ("/healthz", "/api/v1/sessions", "/docs", "/nowhere"):
            problem(server.http.get(path, headers=headers), status)
        found = problem(server.http.put("/api/v1/specs/foreign", content="id: foreign", headers=headers), status)
        assert ("a proxy between must pass on the `Host`" in found["detail"]) == (status == 403)
        assert ("ORACLE_ALLOWED_HOSTS names further ones" in found["detail"]) == (status == 421)
    problem(server.http.get("/api/v1/specs/foreign"), 404)


async def test_foreign_hosts_and_origins_are_refused_on_the_websocket(server: Server) -> None:
    port = int(server.url.rsplit(":", 1)[1])
    for headers, status in foreign(server):
        host = headers.get("Host", f"127.0.0.1:{port}")
        origin = f"Origin: {headers['Origin']}\r\n" if "Origin" in headers else ""
        reader, writer = await asyncio.open_connection("127.0.0.1", port)
        writer.write(HANDSHAKE.format(host=host, origin=origin).encode())
        async with asyncio.timeout(PATIENCE):
            answer = (await reader.read()).decode()
        writer.close()
        await writer.wait_closed()
        assert answer.startswith(f"HTTP/1.1 {status} "), (headers, answer)
        assert "content-type: application/problem+json" in answer.lower()


async def test_a_server_at_all_addresses_of_ipv6_answers_to_those_of_ipv4(start: Starts) -> None:
    port = start(ORACLE_HOST="::", ORACLE_INSECURE="true").url.rsplit(":", 1)[1]
    with httpx.Client(trust_env=False, timeout=PATIENCE) as http:
        for address in ("127.0.0.2", "127.0.0.1", "[::1]", "[0:0::1]", "[::ffff:127.0.0.2]"):
            assert http.get(f"http://{address}:{port}/healthz").status_code == 200, address
        mapped = f"http://[::ffff:127.0.0.2]:{port}/healthz"
        assert http.get(mapped, headers={"Host": f"127.0.0.2:{port}"}).status_code == 200
        problem(http.get(mapped, headers={"Host": f"127.0.0.3:{port}"}), 421)


async def test_the_servers_own_pages_may_ask(server: Server) -> None:
    port = server.url.rsplit(":", 1)[1]
    own = {"Origin": server.url}
    assert server.http.get("/healthz", headers=own).status_code == 200
    named = {"Host": f"localhost:{port}", "Origin": f"http://localhost:{port}"}
    assert server.http.get("/healthz", headers=named).status_code == 200
    address = server.url.replace("http", "ws", 1) + "/api/v1/attach"
    async with connect(address, additional_headers=own, proxy=None, open_timeout=PATIENCE):
        pass
