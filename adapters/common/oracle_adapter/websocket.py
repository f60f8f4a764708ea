"""A WebSocket on an asyncio transport, with no queue between that and its user.

It uses the part of websockets that does no I/O: unlike its clients, this is the same from 9.1,
which distributions still have, to the newest.
"""

from __future__ import annotations

import asyncio
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Optional, cast

from websockets.exceptions import InvalidState
from websockets.typing import Subprotocol
from websockets.uri import parse_uri
from websockets.version import version

if TYPE_CHECKING:
    from websockets.http11 import Response
    from websockets.protocol import Event

try:
    from websockets.frames import Frame, Opcode
except ImportError:
    raise ImportError(
        f"websockets {version} is too old: 9.1 or newer is needed; "
        "install it by `python3 -m pip install --user 'websockets>=9.1'`"
    ) from None

try:
    from websockets.client import ClientProtocol
except ImportError:  # before 11.0
    from websockets.client import ClientConnection as ClientProtocol

_DATA = frozenset({Opcode.TEXT, Opcode.BINARY, Opcode.CONT})
_UNSENT = 1 << 15
"""Bytes that may wait for the other side until it counts as slow."""
SWITCHING = 101
"""The HTTP status of an answer after which messages can be written."""


def _ignore(*_: object) -> None:
    pass


class WebSocket(asyncio.Protocol):
    """A client's end: it hands over messages as they come, and writes many at a time.

    `headers` are added to the request. A message of more than `max_size` bytes ends the connection.
    """

    def __init__(self, url: str, subprotocol: str, headers: Dict[str, str], max_size: int) -> None:
        address: Any = url if version.startswith("9.") else parse_uri(url)
        self._protocol = ClientProtocol(
            address, subprotocols=[Subprotocol(subprotocol)], max_size=max_size
        )
        self.on_message: Callable[[bytes], None] = _ignore
        """Gets each message, and must not raise."""
        self.on_room: Callable[[], None] = _ignore
        """Called once `full` is over."""
        self.full = False
        """Whether so much waits for the other side that nothing more should be written."""
        self._headers = headers
        self._transport: Optional[asyncio.Transport] = None
        self._parts: List[bytes] = []
        loop = asyncio.get_running_loop()
        self._opened: asyncio.Future[Response] = loop.create_future()
        self.closed: asyncio.Future[str] = loop.create_future()
        """Done once there is no connection any more: why that is."""
        self.told = False
        """Whether the other side has said that it closes the connection."""
        self.heard = asyncio.Event()
        """Set whenever something comes from the other side."""

    async def opened(self) -> Response:
        """Wait for the other side's answer: of status 101 where messages can be written.

        Raises `ConnectionError` where it is no answer to a WebSocket, or none comes.
        """
        ends: List[asyncio.Future[Any]] = [self._opened, self.closed]
        await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
        if not self._opened.done():
            raise ConnectionError(self.closed.result())
        answer = self._opened.result()
        if answer.status_code == SWITCHING and self._protocol.state.name != "OPEN":
            raise ConnectionError("the answer is none of a WebSocket server")
        return answer

    def write(self, texts: Iterable[str]) -> None:
        """Write messages without waiting; nothing once the connection is about to end."""
        if self.closed.done():
            return
        with suppress(InvalidState):
            for text in texts:
                self._protocol.send_text(text.encode())
        self._flush()

    def ping(self) -> None:
        """Ask for a sign of life; one that comes sets `heard`."""
        with suppress(InvalidState):
            self._protocol.send_ping(b"")
        self._flush()

    async def close(self, timeout: float) -> None:
        """Close in order, which takes `timeout` seconds at most; `abort` is needed all the same."""
        with suppress(InvalidState):
            self._protocol.send_close(1000)
        self._flush()
        await asyncio.wait([self.closed], timeout=timeout)

    def abort(self) -> None:
        """Break the connection, whatever is still to be written."""
        if self._transport is not None:
            self._transport.abort()

    # What asyncio calls

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """Send the request."""
        self._transport = cast(asyncio.Transport, transport)
        self._transport.set_write_buffer_limits(_UNSENT)
        request = self._protocol.connect()
        request.headers.update(self._headers)
        self._protocol.send_request(request)
        self._flush()

    def data_received(self, data: bytes) -> None:
        """Take in what came."""
        self.heard.set()
        self._take(lambda: self._protocol.receive_data(data))

    def eof_received(self) -> None:
        """Take in that no more will come."""
        self._take(self._protocol.receive_eof)

    def connection_lost(self, exc: Optional[Exception]) -> None:
        """Tell why there is no connection any more."""
        self._end(str(exc or "") or "the connection was lost")
        self._transport = None

    def pause_writing(self) -> None:
        """Note that the other side is slow."""
        self.full = True

    def resume_writing(self) -> None:
        """Go on."""
        self.full = False
        self.on_room()

    def _take(self, receive: Callable[[], None]) -> None:
        with suppress(Exception):  # websockets 9 raises what it notes in `parser_exc`, too
            receive()
        self._flush()
        for event in self._protocol.events_received():
            self._process(event)
        error = self._protocol.parser_exc or getattr(self._protocol, "handshake_exc", None)
        if error is not None:
            self._end(str(error))

    def _process(self, event: Event) -> None:
        if not isinstance(event, Frame):
            self._opened.set_result(cast("Response", event))  # to a client
        elif event.opcode in _DATA:
            self._parts.append(bytes(event.data))
            if event.fin:
                message, self._parts = b"".join(self._parts), []
                self.on_message(message)
        elif event.opcode is Opcode.CLOSE:
            self.told = True
            code, reason = int.from_bytes(event.data[:2], "big"), bytes(event.data[2:]).decode()
            self._end(f"the other side closed it: {code or 'no code'} {reason}".rstrip())

    def _end(self, why: str) -> None:
        if not self.closed.done():
            self.closed.set_result(why)
        if self._transport is not None:
            self._transport.close()

    def _flush(self) -> None:
        data = b"".join(self._protocol.data_to_send())
        if self._transport is not None:
            self._transport.write(data)
