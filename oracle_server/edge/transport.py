"""uvicorn's protocols with limits on how long clients may take to send, read and close, and with an end on demand."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import sys
from collections.abc import Callable, Iterable
from http import HTTPStatus
from typing import Protocol, cast

import h11
from uvicorn._types import ASGISendEvent
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.utils import ClientDisconnected
from websockets.frames import CloseCode, Frame
from websockets.http11 import Request
from websockets.protocol import OPEN

from oracle_server.edge.problems import problem
from oracle_server.edge.slices import SlicedWebSocket
from oracle_server.edge.visitors import REQUEST_WITHIN, Visitor, Visitors

READ_WITHIN = 10.0
"""Seconds for which a client may read nothing although data waits for it."""
_LOOK_EVERY = READ_WITHIN / 10
_ACKED = slice(120, 128)
"""Where `bytes_acked` stands in Linux's `tcp_info`."""
_THERE = b"there?"
"""What a ping says by which it is asked whether a client is there still; the others are of the keepalive."""
_CLOSE_WITHIN = 5.0
"""Seconds for which a closed WebSocket may have unsent data."""
VISITOR = "oracle.visitor"
"""The key of a scope's `state` under which its `Visitor` is."""
DIRECT = "oracle.direct"
"""The ASGI extension under which an application finds the `WebSocketTransport` of its WebSocket."""


class HttpTransport(H11Protocol):
    """One HTTP connection."""

    visitors: Visitors
    visitor: Visitor | None = None
    _request_timer: asyncio.TimerHandle | None = None
    _read_timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Find the visitor whose connection this is: its time for a first request runs since the accept."""
        super().connection_made(transport)
        self.visitor = self.visitors.present.get(transport.get_extra_info("socket").fileno())
        if self.visitor is not None:
            self.visitor.end = transport.abort
        self.app_state = {**self.app_state, VISITOR: self.visitor}

    def data_received(self, data: bytes) -> None:
        """Process data, and abort where a head takes longer than `REQUEST_WITHIN`, or the rest of an answered body.

        A proxy may leave off such a body and send the next request, which would wait as a part of it.
        """
        if self.transport.is_closing():
            return
        super().data_received(data)
        is_due = self.conn.their_state in (h11.IDLE, h11.SEND_BODY)
        waits = is_due and (self.cycle is None or self.cycle.response_complete)
        if not waits:
            self._stop_request_timer()
        elif self._request_timer is None and self.cycle is not None:
            self._request_timer = self.loop.call_later(REQUEST_WITHIN, self.transport.abort)

    def send_400_response(self, msg: str) -> None:
        """Answer data that is not HTTP, and close."""
        self.transport.write(_answer(400, msg))
        self.transport.close()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Pass the connection to the WebSocket protocol."""
        self._stop_request_timer()
        super().handle_websocket_upgrade(event)

    def pause_writing(self) -> None:
        """Look from now on whether the client reads the waiting data."""
        super().pause_writing()
        self._stop_read_timer()
        self._look(None, 0.0)

    def resume_writing(self) -> None:
        """Stop the timer: the client reads again."""
        self._stop_read_timer()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timers."""
        self._stop_request_timer()
        self._stop_read_timer()
        super().connection_lost(exc)

    def _look(self, before: tuple[int, int] | None, since: float) -> None:
        """Abort where the client has read nothing for `READ_WITHIN`; what it had taken `before` it had `since` then."""
        now, taken = self.loop.time(), (self.transport.get_write_buffer_size(), self._acked())
        if taken != before:
            since = now
        elif now - since >= READ_WITHIN:
            self.transport.abort()
            return
        self._read_timer = self.loop.call_later(_LOOK_EVERY, self._look, taken, since)

    def _acked(self) -> int:
        """Bytes that the client's system has received, 0 where this one does not tell: then what waits here shrinks.

        What waits here does so by leaps only, each as large as the system's buffers.
        """
        try:
            told = self.transport.get_extra_info("socket").getsockopt(socket.IPPROTO_TCP, socket.TCP_INFO, _ACKED.stop)
        except (AttributeError, OSError):
            return 0
        return int.from_bytes(told[_ACKED], sys.byteorder)

    def _stop_read_timer(self) -> None:
        if self._read_timer is not None:
            self._read_timer.cancel()
            self._read_timer = None

    def _stop_request_timer(self) -> None:
        if self.visitor is not None:
            self.visitor.spoke()
        if self._request_timer is not None:
            self._request_timer.cancel()
            self._request_timer = None


class Receiver(Protocol):
    """Processes messages on their arrival, without a task that is woken for each."""

    def offer(self, text: str) -> bool:
        """Process a message now; False where it must wait to be received, as must all that arrive before that."""

    def take(self, work: Callable[[], None]) -> None:
        """Let what was read from the socket be processed, which offers each message in it, then write replies."""

    @property
    def rest(self) -> float:
        """For how many seconds nothing more should be read."""


class WebSocketTransport(SlicedWebSocket):
    """One WebSocket; the extensions of its scope hold it as `DIRECT`."""

    receiver: Receiver | None = None
    _cut_off = False
    _answered: asyncio.Event | None = None
    _was_paused = False
    """Whether reading was paused since the last ping was sent, so that its answer may be unread."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Let the visitor end this WebSocket."""
        super().connection_made(transport)
        visitor = self.app_state.get(VISITOR)
        if visitor is not None:
            visitor.end = self.cut_off

    def cut_off(self) -> None:
        """Close the WebSocket, and read nothing more."""
        if self._cut_off:
            return
        self._cut_off, self.receiver = True, None
        if self.handshake_complete and self.conn.state is OPEN and not self.transport.is_closing():
            self.conn.send_close(CloseCode.POLICY_VIOLATION, "what the token allowed has ended")
            self.transport.write(b"".join(self.conn.data_to_send()))
        self.close_sent = True
        self.queue.put_nowait({"type": "websocket.disconnect", "code": int(CloseCode.POLICY_VIOLATION)})
        self.transport.close()
        self.loop.call_later(_CLOSE_WITHIN, self._abort_unsent)

    def handle_connect(self, event: Request) -> None:
        """Add this transport to the extensions of the scope."""
        super().handle_connect(event)
        if not self.close_sent:
            cast("dict[str, object]", self.scope["extensions"])[DIRECT] = self

    def data_received(self, data: bytes) -> None:
        """Process what was read."""
        if not self._cut_off:  # TLS may still hand over what had arrived
            super().data_received(data)

    @property
    def rest(self) -> float:
        """For how many seconds nothing more should be read."""
        return 0.0 if self.receiver is None else self.receiver.rest

    def take_turn(self, work: Callable[[], None]) -> None:
        """Process some slices, whose messages are offered to the receiver, which then writes its replies."""
        if self.receiver is None:
            work()
        else:
            self.receiver.take(work)

    def send_receive_event_to_app(self) -> None:
        """Offer a message to the receiver, or queue it where others wait before it."""
        if self.receiver is not None and self.queue.empty() and not self.close_sent and self._offer(self.receiver):
            self.frames = []
        else:
            super().send_receive_event_to_app()
            self._was_paused |= self.read_paused

    def _offer(self, receiver: Receiver) -> bool:
        if self.curr_msg_data_type != "text":
            return False
        try:
            text = (self.frames[0] if len(self.frames) == 1 else b"".join(self.frames)).decode()
        except UnicodeDecodeError:
            return False
        return receiver.offer(text)

    def write(self, texts: Iterable[bytes]) -> bool:
        """Write messages at once; False where they must wait, since the peer is slow, or the connection is closing."""
        if not self.writable.is_set() or self.transport.is_closing() or self.conn.state is not OPEN:
            return False
        for text in texts:
            self.conn.send_text(text)
        self.transport.write(b"".join(self.conn.data_to_send()))
        return True

    async def reached(self, within: float) -> bool:
        """Whether the client answers a ping within some seconds, or its answer may be unread.

        What its system takes tells nothing: behind a proxy that is the proxy's.
        """
        if self.conn.state is OPEN and not self.transport.is_closing():
            answered = self._answered = self._answered or asyncio.Event()
            answered.clear()
            self.conn.send_ping(_THERE)
            self.transport.write(b"".join(self.conn.data_to_send()))
            try:
                async with asyncio.timeout(within):
                    await answered.wait()
            except TimeoutError:
                return self._was_paused and not self.transport.is_closing()
        return not self.transport.is_closing()

    def handle_pong(self, event: Frame) -> None:
        """Note that the client is there, where that was asked."""
        if bytes(event.data) != _THERE:
            super().handle_pong(event)
        elif self._answered is not None:
            self._answered.set()

    async def send(self, message: ASGISendEvent) -> None:
        """Send a message, unless the socket has failed.

        asyncio reports the failure only later, and until then logs a line for each write.
        """
        if message["type"] == "websocket.send" and self.transport.is_closing():
            raise ClientDisconnected
        await super().send(message)

    async def run_asgi(self) -> None:
        """Run the application, and abort the connection where its data is still unsent after `_CLOSE_WITHIN`."""
        try:
            await super().run_asgi()
        finally:
            cast("dict[str, object]", self.scope["extensions"]).pop(DIRECT, None)  # each would keep the other
            self.loop.call_later(_CLOSE_WITHIN, self._abort_unsent)

    def _abort_unsent(self) -> None:
        with contextlib.suppress(AttributeError):  # raised by asyncio for a TLS connection that has ended
            if self.transport.get_write_buffer_size():
                self.transport.abort()

    def send_keepalive_ping(self) -> None:
        """Send a ping, and note from then on whether reading is paused."""
        self._was_paused = self.read_paused
        super().send_keepalive_ping()

    def _plan(self) -> None:
        super()._plan()
        self._was_paused |= self.read_paused

    def keepalive_timeout(self) -> None:
        """Abort where the peer answers no pings, unless reading was paused, so that its answer may be unread."""
        if self._was_paused and not self.transport.is_closing():
            self.pong_timer = None
            self.pending_ping_payload = None
            self.schedule_ping()
            return
        super().keepalive_timeout()
        self.transport.abort()


def http_transport(of: Visitors) -> type[HttpTransport]:
    """The protocol of a server with these visitors."""

    class Counted(HttpTransport):
        visitors = of

    return Counted


def _answer(status: int, detail: str) -> bytes:
    """A problem as a whole HTTP response in bytes, for a connection without a request."""
    response = problem(status, detail)
    head = f"HTTP/1.1 {status} {HTTPStatus(status).phrase}\r\nconnection: close\r\n".encode()
    fields: list[tuple[bytes, bytes]] = response.raw_headers
    return head + b"".join(b"%s: %s\r\n" % field for field in fields) + b"\r\n" + bytes(response.body)
