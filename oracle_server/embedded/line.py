"""A monitor's connection without a socket: frames from its threads are processed in the thread that brings them."""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple, cast

from starlette.datastructures import State
from starlette.websockets import WebSocket

from oracle_server.attach.connection import Connection
from oracle_server.edge.tokens import Grant
from oracle_server.edge.transport import DIRECT, Receiver
from oracle_server.embedded.turns import TurnsLoop
from oracle_server.sessions.registry import Registry

_WAITING = 64
"""Frames that may wait for the session; the monitor keeps more."""
_FREE_WITHIN = 0.002
"""Seconds that a thread of the monitor waits for the session where another one uses it."""
_SLOW = 0.005
"""Seconds of the processor for which frames keep a thread; after that, the oracle's own takes what follows."""
_APART = 100
"""For so many times what they took: slow frames keep the monitor's threads for a hundredth of the time at most."""


class Ends(NamedTuple):
    """What is called for a monitor, in whatever thread and never while the session is held."""

    receive: Callable[[bytes], None]
    """Takes a frame; nothing is called at the same time."""
    room: Callable[[], None]
    """More frames can be brought now."""
    closed: Callable[[str], None]
    """No more frames will come, and why."""


class Line:
    """What `Connection` takes for a WebSocket, and what brings it the monitor's frames."""

    def __init__(self, loop: TurnsLoop, ends: Ends, hello: str) -> None:
        self.scope: dict[str, Any] = {"subprotocols": [], "extensions": {DIRECT: self}}
        self.state = State({"grant": Grant(frozenset({"admin"}))})
        self.receiver: Receiver | None = None
        """The connection, once its monitor is greeted."""
        self._loop, self._ends = loop, ends
        self._inbox: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._inbox.put_nowait({"type": "websocket.receive", "text": hello})
        self._outgoing: deque[Callable[[], None]] = deque()
        self._delivering = threading.Lock()
        self._crowded = self._closed = False
        self._due = False  # the oracle's thread will look for frames
        self._apart_until = 0.0  # when a thread of the monitor may process one again
        self._deaf = False  # the monitor has hung up

    # From the monitor

    def bring(self, next_frame: Callable[[], str | None]) -> None:
        """Let frames be processed in this thread, and call what answers them.

        Where the session is not free, or its frames are slow, the oracle's own thread does so instead.
        """
        if self._due or time.monotonic() < self._apart_until:
            self.bring_later(next_frame)
            return
        with self._loop.turn(_FREE_WITHIN) as free:
            done = free and self._bring(next_frame)
        self.deliver()
        if not done:
            self.bring_later(next_frame)

    def bring_later(self, next_frame: Callable[[], str | None]) -> None:
        """Let frames be processed in the oracle's own thread, without waiting for it."""
        if not self._due:
            self._due = True
            self._loop.call_from_anywhere(self._go_on, next_frame)

    def _go_on(self, next_frame: Callable[[], str | None]) -> None:
        self._due = False  # before it looks: who has queued a frame by now need not call again
        if not self._bring(next_frame):
            self.bring_later(next_frame)

    def _bring(self, next_frame: Callable[[], str | None]) -> bool:
        """Process frames until there are no more; False where others should have their turn first."""
        began = time.thread_time()  # what it computes, whatever else the machine does
        while not self._closed:
            self._crowded = self._inbox.qsize() >= _WAITING
            if self._crowded:
                return True  # the monitor is called once there is room
            text = next_frame()
            if text is None:
                return True
            if self.receiver is None or not self._inbox.empty():
                self._inbox.put_nowait({"type": "websocket.receive", "text": text})
            else:
                self._offer(self.receiver, text)
            took = time.thread_time() - began
            if took > _SLOW:
                self._apart_until = time.monotonic() + _APART * took
                return False
        return True

    def _offer(self, receiver: Receiver, text: str) -> None:
        def work() -> None:
            if not receiver.offer(text):
                self._inbox.put_nowait({"type": "websocket.receive", "text": text})

        receiver.take(work)

    def hang_up(self) -> None:
        """The monitor hears nothing more, as soon as this returns; the session is told in its own time."""
        self._deaf = True
        with self._delivering:  # what is being called at the moment
            self._outgoing.clear()
        self._loop.call_from_anywhere(self._close, "")

    def deliver(self) -> None:
        """Call what is due for the monitor, in order, unless a thread does already; nothing may be held here."""
        while self._outgoing and self._delivering.acquire(blocking=False):
            try:
                while self._outgoing and not self._deaf:
                    self._outgoing.popleft()()
            finally:
                self._delivering.release()
            if self._deaf:
                return

    # As the connection's socket

    async def accept(self, subprotocol: str | None = None) -> None:
        """There is nothing to accept."""

    async def receive(self) -> dict[str, Any]:
        """The next frame that could not be processed on its arrival."""
        message = await self._inbox.get()
        self._taken()
        return message

    def receive_waiting(self) -> dict[str, Any] | None:
        """The next of them where one waits, else None."""
        if self._inbox.empty():
            return None
        message = self._inbox.get_nowait()
        self._taken()
        return message

    def _taken(self) -> None:
        if self._crowded and self._inbox.qsize() < _WAITING // 2:
            self._crowded = False
            self._put(self._ends.room)

    async def send_text(self, text: str) -> None:
        """Send a frame."""
        self.write((text.encode(),))

    def write(self, texts: Iterable[bytes]) -> bool:
        """Send frames; they are called for as soon as the session is let go."""
        if self._closed:
            return False
        for text in texts:
            self._put(partial(self._ends.receive, text))
        return True

    async def close(self, code: int = 1000, reason: str = "") -> None:  # noqa: ARG002 -- as of a WebSocket
        """No more frames are sent."""
        self._close(reason or "the session was left")

    def _put(self, call: Callable[[], None]) -> None:
        self._outgoing.append(call)

    def _close(self, why: str) -> None:
        if not self._closed:
            self._closed, self.receiver = True, None
            self._inbox.put_nowait({"type": "websocket.disconnect"})
            self._put(partial(self._ends.closed, why))

    async def serve(self, registry: Registry) -> None:
        """Serve the monitor until either side ends it."""
        try:
            await Connection(cast("WebSocket", self), registry).serve()
        finally:
            self._close("the connection failed")
