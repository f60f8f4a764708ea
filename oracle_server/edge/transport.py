"""uvicorn's protocols with an end to every wait: too many connections, slow requests, and peers that have gone."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterable
from http import HTTPStatus
from typing import Protocol, cast

import h11
from uvicorn._types import ASGISendEvent
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request
from websockets.protocol import OPEN

from oracle_server.edge.problems import problem

REQUEST_WITHIN = 10.0
"""Seconds that a client may take for the head of a request, TLS included."""
READ_WITHIN = 10.0
"""Seconds for which a client may read nothing of what waits for it."""
_CLOSE_WITHIN = 5.0
DIRECT = "oracle.direct"
"""Where an application finds the `WebSocketTransport` of a WebSocket among its extensions."""


class HttpTransport(H11Protocol):
    """One connection of HTTP."""

    max_connections = 2_000
    _patience: asyncio.TimerHandle | None = None
    _stalled: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Refuse a connection beyond the limit, before anything of it is read."""
        super().connection_made(transport)
        if len(self.connections) > self.max_connections:
            limit = self.max_connections
            transport.write(_answer(503, f"the server has {limit} connections, and takes no more"))
            transport.close()
            return
        self._patience = self.loop.call_later(REQUEST_WITHIN, transport.abort)

    def data_received(self, data: bytes) -> None:
        """Wait for the head of a request no longer than `REQUEST_WITHIN`, however it trickles in."""
        if self.transport.is_closing():
            return
        super().data_received(data)
        waits = self.conn.their_state is h11.IDLE and (self.cycle is None or self.cycle.response_complete)
        if not waits:
            self._stop_waiting()
        elif self._patience is None:
            self._patience = self.loop.call_later(REQUEST_WITHIN, self.transport.abort)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, and close."""
        self.transport.write(_answer(400, msg))
        self.transport.close()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand the connection on."""
        self._stop_waiting()
        super().handle_websocket_upgrade(event)

    def pause_writing(self) -> None:
        """Give up a client that has stopped to read an answer."""
        super().pause_writing()
        self._stalled = self.loop.call_later(READ_WITHIN, self.transport.abort)

    def resume_writing(self) -> None:
        """It reads again."""
        self._read_again()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the timers with the connection."""
        self._stop_waiting()
        self._read_again()
        super().connection_lost(exc)

    def _read_again(self) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None

    def _stop_waiting(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None


class Receiver(Protocol):
    """Processes messages on their arrival, without a task that is woken for each."""

    def offer(self, text: str) -> bool:
        """Process a message now; False where it must wait to be received, as must all that arrive before that."""

    def flush(self) -> None:
        """Write replies, after each message of a read from the socket was offered."""


class WebSocketTransport(WebSocketsSansIOProtocol):
    """One WebSocket; the extensions of its scope hold it as `DIRECT`."""

    receiver: Receiver | None = None

    def handle_connect(self, event: Request) -> None:
        """Add this transport to the extensions of the scope."""
        super().handle_connect(event)
        if not self.close_sent:
            cast("dict[str, object]", self.scope["extensions"])[DIRECT] = self

    def data_received(self, data: bytes) -> None:
        """Offer the messages in `data` to the receiver, then let it write its replies."""
        super().data_received(data)
        if self.receiver is not None:
            self.receiver.flush()

    def send_receive_event_to_app(self) -> None:
        """Offer a message to the receiver, or queue it where others wait before it."""
        if self.receiver is not None and self.queue.empty() and not self.close_sent and self._offer(self.receiver):
            self.frames = []
        else:
            super().send_receive_event_to_app()

    def _offer(self, receiver: Receiver) -> bool:
        if self.curr_msg_data_type != "text":
            return False
        try:
            text = b"".join(self.frames).decode()
        except UnicodeDecodeError:
            return False
        return receiver.offer(text)

    def write(self, texts: Iterable[bytes]) -> bool:
        """Write messages in one go; False where they have to wait, since the peer is slow or leaves, or has gone."""
        if not self.writable.is_set() or self.transport.is_closing() or self.conn.state is not OPEN:
            return False
        for text in texts:
            self.conn.send_text(text)
        self.transport.write(b"".join(self.conn.data_to_send()))
        return True

    async def send(self, message: ASGISendEvent) -> None:
        """Send nothing more where the socket has failed.

        asyncio tells that in its next turn, and until then takes all that is sent, with a line in the log for each.
        """
        if message["type"] == "websocket.send" and self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)

    async def run_asgi(self) -> None:
        """Leave no socket behind: closing in order waits for bytes to leave that no one may be there to take."""
        try:
            await super().run_asgi()
        finally:
            self.loop.call_later(_CLOSE_WITHIN, self._let_go)

    def _let_go(self) -> None:
        with contextlib.suppress(AttributeError):  # over TLS, what asyncio says of a connection that has ended
            if self.transport.get_write_buffer_size():
                self.transport.abort()

    def keepalive_timeout(self) -> None:
        """Give up a peer that answers no pings, unless it is we who have not read its answer."""
        if self.read_paused and not self.transport.is_closing():
            self.pong_timer = None
            self.pending_ping_payload = None
            self.schedule_ping()
            return
        super().keepalive_timeout()
        self.transport.abort()


def bounded(max_connections: int) -> type[HttpTransport]:
    """The protocol of a server that takes so many connections, WebSockets included."""

    class Bounded(HttpTransport):
        pass

    Bounded.max_connections = max_connections
    return Bounded


def _answer(status: int, detail: str) -> bytes:
    """A problem as bytes, for where there is no request that could be answered."""
    response = problem(status, detail)
    head = f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\nconnection: close\r\n".encode()
    fields: list[tuple[bytes, bytes]] = response.raw_headers
    return head + b"".join(b"%s: %s\r\n" % field for field in fields) + b"\r\n" + bytes(response.body)
