"""The other side of the wire: a real WebSocket server whose every move a test makes."""

from __future__ import annotations

import asyncio
import json
import queue
import socket
import sys
import threading
from concurrent.futures import Future
from http import HTTPStatus
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Callable, Coroutine, Dict, Iterator, List, Optional, cast

import pytest
from websockets.frames import Frame as Piece
from websockets.frames import Opcode
from websockets.http11 import Request
from websockets.typing import Subprotocol

try:
    from websockets.server import ServerProtocol
except ImportError:  # before 11.0
    from websockets.server import ServerConnection as ServerProtocol

if find_spec("oracle_adapter") is None:
    sys.path.insert(0, str(Path(__file__).parents[3] / "adapters" / "common"))

from oracle_adapter import Board, Link
from tests.adapters.common.boards import Clock, Screen
from tests.adapters.common.links import PATIENCE, QUICK
from tests.adapters.common.side import Side

Frame = Dict[str, Any]


class Peer(asyncio.Protocol):
    """The server's end of one connection; a test's calls are from its own thread.

    It stands, as the link does, on what all versions of websockets have.
    """

    def __init__(self, oracle: Oracle, loop: asyncio.AbstractEventLoop) -> None:
        self.finished = threading.Event()
        self.frames: queue.Queue[Frame] = queue.Queue()
        self._oracle, self._loop = oracle, loop
        self._protocol = ServerProtocol(subprotocols=[Subprotocol("oracle.v1")], max_size=1 << 26)

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = cast(asyncio.Transport, transport)
        self._oracle.transports.append(self.transport)

    def data_received(self, data: bytes) -> None:
        self._protocol.receive_data(data)
        self._flush()
        for event in self._protocol.events_received():
            if isinstance(event, Request):
                self._answer(event)
            elif isinstance(event, Piece) and event.opcode is Opcode.TEXT:
                self.frames.put(json.loads(bytes(event.data)))

    def connection_lost(self, exc: Optional[Exception]) -> None:
        self.finished.set()

    def _answer(self, request: Request) -> None:
        self._oracle.requests.put(request)
        refusal = self._oracle.refuse_with
        if refusal is None:
            answer = self._protocol.accept(request)
            self._oracle.peers.put(self)
        else:
            answer = self._protocol.reject(refusal, "no\n")
        self._protocol.send_response(answer)
        self._flush()

    def _flush(self) -> None:
        for data in self._protocol.data_to_send():
            if data:
                self.transport.write(data)
            else:
                self.transport.close()

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
        self.send_in_pieces([text])

    def send_in_pieces(self, pieces: List[str]) -> None:
        """Send a text as a proxy may: in several frames."""
        texts = [piece.encode() for piece in pieces]

        def send() -> None:
            last = len(texts) - 1
            self._protocol.send_text(texts[0], fin=not last)
            for number, text in enumerate(texts[1:], start=1):
                self._protocol.send_continuation(text, fin=number == last)
            self._flush()

        self._call(send)

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
        self._call(self.transport.abort)

    def close(self, code: int = 1000) -> None:
        """Say that this is the end, and wait for the other side to agree."""

        def close() -> None:
            self._protocol.send_close(code)
            for data in self._protocol.data_to_send():
                self.transport.write(data)

        self._call(close)
        self.wait_finished()

    def freeze(self) -> None:
        """Read and answer nothing more, not even pings, as a machine that lost its power."""
        self._call(self.transport.pause_reading)

    def wait_finished(self) -> None:
        assert self.finished.wait(PATIENCE)

    def _call(self, work: Callable[[], None]) -> None:
        """Have it done in the loop's thread, where the connection still is."""
        done: Future[None] = Future()

        def run() -> None:
            try:
                work()
                done.set_result(None)
            except Exception as error:  # noqa: BLE001 - raised where it can be handled
                done.set_exception(error)

        self._loop.call_soon_threadsafe(run)
        done.result(PATIENCE)


class Oracle:
    """A server in a thread of its own that does nothing by itself."""

    def __init__(self) -> None:
        self.refuse_with: Optional[HTTPStatus] = None
        self.requests: queue.Queue[Request] = queue.Queue()
        self._place = socket.socket()  # bound all the time: nobody else gets the port
        self._place.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._place.bind(("127.0.0.1", 0))
        self.port = int(self._place.getsockname()[1])
        self.peers: queue.Queue[Peer] = queue.Queue()
        self.transports: List[asyncio.Transport] = []
        self._loop = asyncio.new_event_loop()
        self._server: Optional[asyncio.AbstractServer] = None
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

    async def _break(self, server: asyncio.AbstractServer) -> None:
        for listening in cast("asyncio.Server", server).sockets:
            self._loop.remove_reader(listening.fileno())
        # Python 3.11 leaves open what it is accepting while the server closes.
        accepting = asyncio.all_tasks() - {asyncio.current_task()}
        await asyncio.gather(*accepting, return_exceptions=True)
        server.close()
        await asyncio.sleep(0)  # what has just come is known from the next turn on
        for transport in self.transports:
            transport.abort()
        await server.wait_closed()
        await asyncio.sleep(0)

    def end(self) -> None:
        self.stop()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._place.close()

    def accept(self) -> Peer:
        """The next connection."""
        return self.peers.get(timeout=PATIENCE)

    async def _serve(self) -> asyncio.AbstractServer:
        loop = self._loop
        return await loop.create_server(lambda: Peer(self, loop), "127.0.0.1", self.port)

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


@pytest.fixture
def screen() -> Screen:
    return Screen()


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def board(screen: Screen, clock: Clock) -> Board:
    return Board("uav1", screen, clock)
