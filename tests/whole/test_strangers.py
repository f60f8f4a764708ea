"""Who has no token, and connects as often as they can: others are let in, and the log stays short."""

from __future__ import annotations

import asyncio
import json
import socket
import ssl
from contextlib import ExitStack, suppress
from pathlib import Path

import httpx
import pytest
from websockets.asyncio.client import connect

from oracle_server.edge.tokens import add
from oracle_server.edge.visitors import LEAVING, STRANGERS, Visitors
from tests.chaos.served import Served
from tests.whole.client import attached, make_attach, make_event
from tests.whole.conftest import Starts, copy_specs
from tests.whole.harness import PATIENCE, Server, problem
from tests.whole.test_tls import Authority

IMPATIENT = "from oracle_server.edge import visitors; visitors.REQUEST_WITHIN = 0.5"


@pytest.fixture(scope="module")
def authority(tmp_path_factory: pytest.TempPathFactory) -> Authority:
    return Authority(tmp_path_factory.mktemp("tls") / "pki")


def knock(server: Server, count: int, stack: ExitStack) -> list[socket.socket]:
    """So many connections on which nothing is said."""
    host, port = server.url.partition("://")[2].split(":")
    made = [stack.enter_context(socket.create_connection((host, int(port)), PATIENCE)) for _ in range(count)]
    for one in made:
        one.setblocking(False)
    return made


def still_open(made: list[socket.socket]) -> int:
    """How many of these connections the server has not closed."""
    count = 0
    for one in made:
        with suppress(ConnectionError):
            try:
                one.recv(1)
            except BlockingIOError:
                count += 1
    return count


async def test_silent_connections_keep_nobody_out_and_fill_no_log(
    start: Starts, authority: Authority, tmp_path: Path
) -> None:
    secret = add(tmp_path / "data" / "tokens.json", "robot", ["admin"])
    server = start(ORACLE_MAX_CONNECTIONS="50", **authority.settings)
    headers = {"Authorization": f"Bearer {secret}"}
    context, url = authority.context(), server.url.replace("https", "wss", 1) + "/api/v1/attach"
    secured = {"ssl": context, "additional_headers": headers, "proxy": None, "open_timeout": PATIENCE}
    async with connect(url, **secured) as known:  # type: ignore[arg-type]
        await known.send(json.dumps(make_attach(session="s", spec="single")))
        assert json.loads(await known.recv())["type"] == "attached"
        with ExitStack() as stack:
            made: list[socket.socket] = []
            for _ in range(20):
                made += await asyncio.to_thread(knock, server, 60, stack)
                async with httpx.AsyncClient(verify=context, trust_env=False, timeout=PATIENCE) as http:
                    answer = await http.get(f"{server.url}/api/v1/sessions", headers=headers)
                    assert answer.status_code == 200
            left = await server.until(lambda: still_open(made), lambda n: n <= 50 + STRANGERS)
            assert left > 0, "there is room for those who come slowly"
            await known.send(json.dumps(make_event(1, data={"v": 1}, ask=True)))
            while json.loads(await known.recv())["type"] != "decision":
                pass
    told = [line for line in server.log.splitlines() if "without a token were closed" in line]
    assert told
    assert sum(int(line.partition("count=")[2].split()[0]) for line in told) <= 20 * 60
    assert len(server.log.splitlines()) < 100


async def test_a_handshake_that_does_not_go_on_is_not_waited_for(authority: Authority, tmp_path: Path) -> None:
    async def ended(text: bytes) -> bytes:
        reader, writer = await asyncio.open_connection("127.0.0.1", served.port)
        writer.write(text)
        async with asyncio.timeout(PATIENCE):
            try:
                return await reader.read()
            except ConnectionError:
                return b""
            finally:
                writer.close()

    hello = ssl.MemoryBIO()
    with suppress(ssl.SSLWantReadError):
        authority.context().wrap_bio(ssl.MemoryBIO(), hello, server_hostname="127.0.0.1").do_handshake()
    whole = hello.read()
    settings = {name.removeprefix("ORACLE_"): value for name, value in authority.settings.items()}
    async with Served(copy_specs(tmp_path / "specs", ()), tmp_path / "data", IMPATIENT, **settings) as served:
        await asyncio.gather(ended(b""), ended(whole[:20]), ended(whole))
        await served.said("connections sent no request in time")


async def test_beyond_the_limit_a_request_is_refused_and_health_is_told(start: Starts) -> None:
    server = start(ORACLE_MAX_CONNECTIONS="3")
    async with (
        attached(server, "m1", session="s", spec="single"),
        attached(server, "m2", session="s", spec="single"),
        attached(server, "m3", session="s", spec="single"),
    ):
        body = problem(server.http.get("/api/v1/sessions"), 503)
        assert "connections" in body["detail"]
        assert server.http.get("/healthz").status_code == 200
    await server.until(lambda: server.http.get("/api/v1/sessions").status_code, lambda status: status == 200)


class Caller:
    """A connection that was accepted, as the visitors see it."""

    def __init__(self, all_of_them: Visitors, number: int, address: str) -> None:
        self.ended = False
        self.place = all_of_them.admit(number, address, self.end)

    def end(self) -> None:
        self.ended = True


async def test_who_has_shown_a_token_stays_and_the_crowded_address_makes_room() -> None:
    here = Visitors(10)
    kept = [Caller(here, n, "192.0.2.1") for n in range(10)]
    assert all(one.place and one.place.prove() for one in kept)
    quiet = Caller(here, 10, "198.51.100.7")
    crowd = [Caller(here, 100 + n, f"2001:db8::{n:x}") for n in range(STRANGERS + LEAVING - 1)]
    assert [one.ended for one in crowd] == [True] * LEAVING + [False] * (STRANGERS - 1), "the oldest of one network"
    assert not quiet.ended
    assert not any(one.ended for one in kept)
    late = Caller(here, 999, "203.0.113.5")
    assert late.place is None, "those that were closed have not ended yet"
    for one in crowd:
        if one.ended and one.place:
            one.place.left()
    late = Caller(here, 999, "203.0.113.5")
    assert late.place
    assert not late.place.prove(), "as many as may stay have shown a token"
    assert kept[0].place
    kept[0].place.left()
    assert late.place.prove()
    for one in [*kept, *crowd, quiet, late]:
        if one.place:
            one.place.left()
    assert here.present == {}
