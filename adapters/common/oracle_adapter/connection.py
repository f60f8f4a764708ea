"""One WebSocket connection: it transfers frames, whatever they mean."""

from __future__ import annotations

import asyncio
import inspect
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Coroutine, Dict, Iterator, Optional, cast
from urllib.parse import urlsplit, urlunsplit

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.typing import Subprotocol

from oracle_adapter.errors import LinkError
from oracle_adapter.websocket import WebSocket

if TYPE_CHECKING:
    from ssl import SSLContext

PATH = "/api/v1/attach"
MAX_MESSAGE = 1 << 26
"""Bytes of a frame from the server: a violation carries its events."""
_AT_ONCE = 1 << 14
"""Bytes that are written in one go, or one frame: a ping waits behind them."""
REFUSALS = {401: "unauthorized", 403: "forbidden", 421: "misdirected"}
"""HTTP statuses that another attempt does not change."""
FAILURES = (OSError, EOFError, asyncio.TimeoutError, WebSocketException)
"""What a connection that fails raises."""


@dataclass(frozen=True)
class Timing:
    """The link's time limits, in seconds.

    A connection on which nothing comes for `ping_interval + ping_timeout` is given up. The time
    between attempts doubles from `backoff_first` to `backoff_last`, each shortened at random by up
    to a half.
    """

    open_timeout: float = 3.0
    attach_timeout: float = 10.0
    ping_interval: float = 1.0
    ping_timeout: float = 2.0
    close_timeout: float = 1.0
    backoff_first: float = 0.1
    backoff_last: float = 2.0


@dataclass(frozen=True)
class Address:
    """The oracle's address and what it requires; `url` is as `attach_url` returns it."""

    url: str
    token: Optional[str] = None
    tls: Optional[SSLContext] = None


def attach_url(url: str) -> str:
    """The WebSocket address for a server given as `ws://`, `wss://`, `http://` or `https://`."""
    parts = urlsplit(url)
    scheme = {"ws": "ws", "http": "ws", "wss": "wss", "https": "wss"}.get(parts.scheme)
    if scheme is None or not parts.hostname or parts.port == 0:  # a bad port raises by itself
        raise ValueError(f"{url!r} is no address like ws://127.0.0.1:8642")
    path = parts.path.rstrip("/")
    path = path if path.endswith(PATH) else path + PATH
    return urlunsplit((scheme, parts.netloc, path, parts.query, ""))


async def open_connection(address: Address, timing: Timing) -> WebSocket:
    """Open a WebSocket; raises a fatal `LinkError` where it is refused, or one of `FAILURES`."""
    options: Dict[str, Any] = {} if address.tls is None else {"ssl": address.tls}
    # An oracle is on the robot's own network: websockets for Python 3.8 uses no proxies, and
    # newer versions must not look for one either.
    if "proxy" in inspect.signature(connect.__init__).parameters:
        options["proxy"] = None
    try:
        socket = await connect(
            address.url,
            create_connection=WebSocket,
            subprotocols=[Subprotocol("oracle.v1")],
            additional_headers=_headers(address.token),
            compression=None,
            open_timeout=timing.open_timeout,
            close_timeout=timing.close_timeout,
            ping_interval=None,  # Conversation pings: see there
            max_size=MAX_MESSAGE,
            **options,
        )
        return cast(WebSocket, socket)  # by create_connection
    except InvalidStatus as error:
        status = error.response.status_code
        if status in REFUSALS:
            message = f"{address.url} answered HTTP {status}"
            raise LinkError(REFUSALS[status], message, fatal=True) from error
        raise


def _headers(token: Optional[str]) -> Dict[str, str]:
    return {"Authorization": f"Bearer {token}"} if token else {}


async def _until_closed(work: Coroutine[Any, Any, None]) -> None:
    """Do not end where the connection is closed: frames may still be unread."""
    with suppress(ConnectionClosed):
        await work
        return
    await asyncio.Event().wait()


class Conversation:
    """Frames to and fro on one connection.

    `receive` takes each frame and returns whether it was the last; `next_frame` returns the next
    one to write or None, and is called again by `pump`.
    """

    def __init__(
        self,
        socket: WebSocket,
        timing: Timing,
        *,
        receive: Callable[[bytes], bool],
        next_frame: Callable[[], Optional[str]],
    ) -> None:
        self._socket, self._timing = socket, timing
        self._receive, self._next_frame = receive, next_frame
        loop = asyncio.get_running_loop()
        self._time = loop.time
        self._received_at = 0.0  # when the last frame came
        self._over: asyncio.Future[None] = loop.create_future()  # the last frame, or what failed

    async def run(self, hello: str) -> None:
        """Return after the last frame and a close in order; raise where it ends otherwise."""
        socket = self._socket
        socket.on_message, socket.on_room = self._take, self.pump
        socket.write([hello])
        watching = asyncio.ensure_future(_until_closed(self._watch()))
        closed = asyncio.ensure_future(socket.wait_closed())
        try:
            await asyncio.wait([self._over, watching, closed], return_when=asyncio.FIRST_COMPLETED)
            if self._over.done():
                self._over.result()
            elif closed.done():
                raise socket.protocol.close_exc
            else:
                watching.result()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(socket.close(), self._timing.close_timeout)
        finally:
            self._over.cancel()  # later frames are ignored
            # A closing handshake would wait for unsent bytes, though the other side may be gone.
            socket.transport.abort()
            watching.cancel()
            closed.cancel()
            await asyncio.gather(watching, closed, return_exceptions=True)

    def pump(self) -> None:
        """Write what there is to write; the rest later, where the other side is slow."""
        while not self._socket.full and not self._over.done():
            texts = list(self._some())
            if not texts:
                return
            self._socket.write(texts)

    def _some(self) -> Iterator[str]:
        size = 0
        while size < _AT_ONCE:
            frame = self._next_frame()
            if frame is None:
                return
            size += len(frame)
            yield frame

    def _take(self, message: bytes) -> None:
        if self._over.done():
            return
        self._received_at = self._time()
        try:
            if self._receive(message):
                self._over.set_result(None)
        except Exception as error:  # noqa: BLE001 - raised where it can be handled
            self._over.set_exception(error)

    async def _watch(self) -> None:
        """Raise where nothing comes from the other side.

        The keepalive of websockets does not suffice: with a full send buffer it waits without end
        to write its ping. A ping may be queued after much data on a slow line, so
        any frame that comes in the meantime counts as an answer.
        """
        answer_due = self._time() + self._timing.attach_timeout
        while True:
            await asyncio.sleep(self._timing.ping_interval)
            await self._check_alive()
            if not self._received_at and self._time() > answer_due:
                message = f"no answer to attach for {self._timing.attach_timeout} s"
                raise LinkError("unreachable", message)

    async def _check_alive(self) -> None:
        started = self._time()
        ping = asyncio.ensure_future(self._ping())
        try:
            while not ping.done():
                left = max(started, self._received_at) + self._timing.ping_timeout - self._time()
                if left <= 0:
                    message = f"no sign of the server for {self._timing.ping_timeout} s"
                    raise LinkError("disconnected", message)
                # Not wait_for: before Python 3.12 it can swallow a cancellation.
                await asyncio.wait([ping], timeout=left)
            ping.result()
        finally:
            ping.cancel()
            await asyncio.gather(ping, return_exceptions=True)

    async def _ping(self) -> None:
        await (await self._socket.ping())
