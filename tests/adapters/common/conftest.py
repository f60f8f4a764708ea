"""The other side of the wire: a real WebSocket server whose every move a test makes."""

from __future__ import annotations

import asyncio
import json
import queue
import socket
import sys
import threading
from http import HTTPStatus
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Coroutine, Dict, Iterator, List, Optional

import pytest
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

if find_spec("oracle_adapter") is None:
    sys.path.insert(0, str(Path(__file__).parents[3] / "adapters" / "common"))

from oracle_adapter import Link
from tests.adapters.common.links import PATIENCE, QUICK
from tests.adapters.common.side import Side

Frame = Dict[str, Any]


class Peer:
    """The server's end of one connection; all calls are from the test's thread."""

    def __init__(self, socket: ServerConnection, loop: asyncio.AbstractEventLoop) -> None:
        self.socket = socket
        self.finished = threading.Event()
        self.frames: queue.Queue[Frame] = queue.Queue()
        self._loop = loop

    def recv(self) -> Frame:
        """The next frame from the client."""
        return self.frames.get(timeout=PATIENCE)

    def events(self, count: int) -> List[Frame]:
        """The next events, in batches or not; anything else between them fails."""
        found: List[Frame] = []
        while len(found) < count:
            frame = self.recv()
            found += frame["events"] if frame["type"] == "events" else [frame]
        assert all(event["type"] == "event" for event in found)
        assert len(found) == count
        return found

    def send(self, type_: str, **fields: Any) -> None:
        self.send_text(json.dumps({"type": type_, **fields}))

    def send_text(self, text: str) -> None:
        self._run(self.socket.send(text))

    def send_in_pieces(self, pieces: List[str]) -> None:
        """Send a text as a proxy may: in several frames."""
        self._run(self.socket.send(pieces))

    def attach(self, upcoming: int = 1, session: str = "s1", **fields: Any) -> Frame:
        """Read `attach` and answer it."""
        hello = self.recv()
        assert hello["type"] == "attach"
        answer = {
            "monitor": hello["monitor"],
            "session": hello.get("session", session),
            "spec": hello.get("spec", "spec"),
            "spec_digest": "d1",
            "streams": [{"name": "/a", "kind": "topic"}],
            "next": upcoming,
            "limits": {"max_frame": 1 << 20},
        }
        self.send("attached", **{**answer, **fields})
        return hello

    def drop(self) -> None:
        """Break the connection without a word."""
        self._loop.call_soon_threadsafe(self.socket.transport.abort)

    def close(self, code: int = 1000) -> None:
        self._run(self.socket.close(code))

    def freeze(self) -> None:
        """Read and answer nothing more, not even pings, as a machine that lost its power."""
        self._loop.call_soon_threadsafe(self.socket.transport.pause_reading)

    def wait_finished(self) -> None:
        assert self.finished.wait(PATIENCE)

    def _run(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)


class Oracle:
    """A server in a thread of its own that does nothing by itself."""

    def __init__(self) -> None:
        self.refuse_with: Optional[HTTPStatus] = None
        self.requests: queue.Queue[Request] = queue.Queue()
        self._place = socket.socket()  # bound all the time: nobody else gets the port
        self._place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._place.bind(("127.0.0.1", 0))
        self.port = int(self._place.getsockname()[1])
        self._peers: queue.Queue[Peer] = queue.Queue()
        self._transports: List[asyncio.Transport] = []
        self._loop = asyncio.new_event_loop()
        self._server: Optional[Server] = None
        self._thread = threading.Thread(target=self._loop.run_forever)
        self._thread.start()

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def start(self) -> None:
        """Listen, again on the same port where it did before."""
        self._server = self._run(self._serve())

    def stop(self) -> None:
        """Break every connection and listen no more."""
        server, self._server = self._server, None
        if server is not None:
            self._run(self._break(server))

    async def _break(self, server: Server) -> None:
        server.close(False)
        await asyncio.sleep(0)  # what has just come is known from the next turn on
        for transport in self._transports:
            transport.abort()
        await server.wait_closed()
        await asyncio.sleep(0)

    def end(self) -> None:
        self.stop()
        self._run(self._cancel_the_rest())
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._place.close()

    async def _cancel_the_rest(self) -> None:
        """A connection may have come just as the server closed."""
        rest = asyncio.all_tasks() - {asyncio.current_task()}
        for task in rest:
            task.cancel()
        await asyncio.gather(*rest, return_exceptions=True)

    def accept(self) -> Peer:
        """The next connection."""
        return self._peers.get(timeout=PATIENCE)

    async def _serve(self) -> Server:
        transports = self._transports

        class Connection(ServerConnection):
            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                assert isinstance(transport, asyncio.Transport)
                transports.append(transport)
                super().connection_made(transport)

        return await serve(
            self._handle,
            "127.0.0.1",
            self.port,
            process_request=self._process_request,
            subprotocols=["oracle.v1"],  # type: ignore[list-item]
            ping_interval=None,
            create_connection=Connection,
        )

    def _process_request(self, socket: ServerConnection, request: Request) -> Optional[Response]:
        self.requests.put(request)
        if self.refuse_with is None:
            return None
        return socket.respond(self.refuse_with, "no\n")

    async def _handle(self, socket: ServerConnection) -> None:
        peer = Peer(socket, self._loop)
        self._peers.put(peer)
        try:
            async for text in socket:
                peer.frames.put(json.loads(text))
        except ConnectionClosed:
            pass
        finally:
            peer.finished.set()

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)


@pytest.fixture
def oracle() -> Iterator[Oracle]:
    oracle = Oracle()
    oracle.start()
    yield oracle
    oracle.end()


class News:
    """What a link has called back with."""

    def __init__(self) -> None:
        self.violations: queue.Queue[Any] = queue.Queue()
        self.verdicts: queue.Queue[Any] = queue.Queue()
        self.states: queue.Queue[Any] = queue.Queue()
        self.errors: queue.Queue[Any] = queue.Queue()

    def callbacks(self) -> Dict[str, Any]:
        return {
            "on_violation": self.violations.put,
            "on_state": lambda state, detail: self.states.put((state, detail)),
            "on_error": self.errors.put,
        }

    def state(self) -> str:
        return str(self.states.get(timeout=PATIENCE)[0])

    def error(self) -> Any:
        return self.errors.get(timeout=PATIENCE)


@pytest.fixture
def news() -> News:
    return News()


@pytest.fixture
def links() -> Iterator[List[Link]]:
    """Links to end with the test, whatever becomes of it."""
    made: List[Link] = []
    yield made
    for link in made:
        link.close(timeout=0)


@pytest.fixture
def link(oracle: Oracle, news: News, links: List[Link]) -> Link:
    links.append(Link(oracle.url, "uav1", timing=QUICK, **news.callbacks()))
    links[0].start()
    return links[0]


@pytest.fixture
def often_switched() -> Iterator[None]:
    """Threads take turns so often that they meet in every line."""
    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(usual)


@pytest.fixture
def side() -> Side:
    return Side()
