"""What is read from a WebSocket is processed in slices, and other connections are served between them."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from functools import partial
from typing import Any, cast

from uvicorn._types import ASGIReceiveEvent, ASGISendEvent
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import Frame

SLICE = 2**12
"""Bytes that are processed at once: no more than some hundred of the smallest frames."""
_TURN = 0.0005
"""Seconds after which other connections are served."""
_READ = 2**16
"""Bytes that are read from the socket at once: asyncio's 256 KiB take as long as a turn to copy."""
MOST = 1_000
_AHEAD = 2**20
"""Messages that may wait, and bytes that may be processed while any does, before nothing more is looked at."""
LOOK = 0.5
"""Seconds after which something is read although it should rest: an adapter gives up after 2 s without a pong."""


class SlicedWebSocket(WebSocketsSansIOProtocol):
    """A WebSocket that is read no faster than what was read is processed.

    A socket hands over 64 KiB, which may be 10,000 frames.
    """

    _unread = b""
    _at = 0
    """Where in `_unread` the next slice begins."""
    _ahead = 0
    """Bytes that were processed since the last time that no message waited."""
    _next: asyncio.Handle | None = None
    """What goes on with it; None while nothing is unread, or a message waits for the application."""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Read less at once."""
        super().connection_made(transport)
        cast("Any", transport).max_size = _READ

    @property
    def rest(self) -> float:
        """For how many seconds nothing more should be read."""
        return 0.0

    def take_turn(self, work: Callable[[], None]) -> None:
        """Process some slices: all of a turn at once, since a slice is less than its accounting would be worth."""
        work()

    def process(self, data: bytes) -> None:
        """Process a slice."""
        super().data_received(data)

    def data_received(self, data: bytes) -> None:
        """Process the first slices of what was read."""
        self._unread, self._at = self._unread[self._at :] + data, 0
        if self._next is None:
            self._go_on()

    async def receive(self) -> ASGIReceiveEvent:
        """The next message; once none waits, what was read is gone on with."""
        message = await self.queue.get()
        self._taken()
        return message

    def receive_waiting(self) -> ASGIReceiveEvent | None:
        """The next message where one waits, else None."""
        if self.queue.empty():
            return None
        message = self.queue.get_nowait()
        self._taken()
        return message

    async def send(self, message: ASGISendEvent) -> None:
        """Send a message; after the last one, what is unread may hold the peer's close."""
        await super().send(message)
        if self.close_sent and self._unread and self._next is None:
            self._next = self.loop.call_soon(self._go_on)

    def connection_lost(self, exc: Exception | None) -> None:
        """Process what was read before, for nobody may send it again."""
        if self._next is not None:
            self._next.cancel()
        self._lose(exc)

    def handle_cont(self, event: Frame) -> None:
        """Join a fragment to those before it: each would be kept by itself, and empty ones are never too many."""
        begun = cast("bytes | bytearray", self.frames[0])
        whole = begun if isinstance(begun, bytearray) else bytearray(begun)
        whole += event.data
        self.frames = [bytes(whole) if event.fin else cast("bytes", whole)]
        if event.fin:
            self.send_receive_event_to_app()

    def handle_ping(self) -> None:
        """Answer a ping, unless the connection is lost."""
        if not self.transport.is_closing():
            super().handle_ping()

    def _taken(self) -> None:
        if self.queue.empty() and self._next is None:
            if self._unread:
                self._next = self.loop.call_soon(self._go_on)  # a later message must not overtake this one
            else:
                self._read_on()

    def _lose(self, exc: Exception | None) -> None:
        self._process(anyway=True)
        if self._unread and not self.close_sent:
            self.loop.call_soon(self._lose, exc)
        else:
            super().connection_lost(exc)

    def _go_on(self, *, anyway: bool = False) -> None:
        self._next = None
        self._process(anyway=anyway)
        if not self.transport.is_closing():
            self._plan()

    def _process(self, *, anyway: bool) -> None:
        if self._unread:
            self.take_turn(partial(self._process_slices, anyway=anyway))

    def _process_slices(self, *, anyway: bool) -> None:
        """Process slices until the turn is over, or, unless `anyway`, a message waits or nothing should be read."""
        end = time.monotonic() + _TURN
        if not self._waits:
            self._ahead = 0
        while self._at < len(self._unread):
            data = self._unread[self._at : self._at + SLICE]
            self._at += SLICE
            self._ahead += len(data)
            self.process(data)
            if time.monotonic() > end or (not anyway and (self._waits or self.rest)):
                break
        if self._at >= len(self._unread):
            self._unread, self._at = b"", 0

    def _plan(self) -> None:
        """Go on when it is time to."""
        rest, waits = self.rest, self._waits
        if not (rest or waits or self._unread):
            self._read_on()
            return
        if not self.read_paused:
            self.read_paused = True
            self.transport.pause_reading()
        if rest:
            self._next = self.loop.call_later(min(rest, LOOK), self._look)
        elif not waits:
            self._next = self.loop.call_soon(self._go_on)

    def _look(self) -> None:
        """Read something, for there may be a ping; messages wait for the application, and not too many."""
        self._next = None
        if self._waits and (self.queue.qsize() >= MOST or self._ahead >= _AHEAD):
            self._plan()
        elif self._unread:
            self._go_on(anyway=True)
        else:
            self._read_on()

    def _read_on(self) -> None:
        if self.read_paused:
            self.read_paused = False
            self.transport.resume_reading()

    @property
    def _waits(self) -> bool:
        return not self.queue.empty() and not self.close_sent
