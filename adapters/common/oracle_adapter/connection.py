"""One WebSocket connection: it moves frames and knows nothing of what they mean."""

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
"""HTTP statuses that asking again won't change."""
FAILURES = (OSError, EOFError, asyncio.TimeoutError, WebSocketException)
"""What a connection that fails raises."""


@dataclass(frozen=True)
class Timing:
    """How patient the link is, in seconds.

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
    """Where the oracle is, and what it wants to see: `url` as `attach_url` makes it."""

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
    # An oracle is on the robot's own network: the version for Python 3.8 knows no proxies, and the
    # newer ones shall not look for one either.
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
        return cast(WebSocket, socket)  # what it was told to create
    except InvalidStatus as error:
        status = error.response.status_code
        if status in REFUSALS:
            message = f"{address.url} answered HTTP {status}"
            raise LinkError(REFUSALS[status], message, fatal=True) from error
        raise


def _headers(token: Optional[str]) -> Dict[str, str]:
    return {"Authorization": f"Bearer {token}"} if token else {}


async def _until_closed(work: Coroutine[Any, Any, None]) -> None:
    """Leave it to others to find the connection closed: frames may still be on their way."""
    with suppress(ConnectionClosed):
        await work
        return
    await asyncio.Event().wait()


class Conversation:
    """Frames to and fro on one connection.

    `receive` takes each frame and says whether it was the last; `next_frame` gives the next one to
    write or None, and is asked again whenever `pump` is called.
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
        self._heard = 0.0  # when the last frame came
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
            self._over.cancel()  # what still comes is not for this conversation
            # Closing in order would wait for bytes to leave that no one may be there to take.
            socket.transport.abort()
            watching.cancel()
            closed.cancel()
            await asyncio.gather(watching, closed, return_exceptions=True)

    def pump(self) -> None:
        """Write what there is to write, unless the other side is slow to take it: then after it."""
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
        self._heard = self._time()
        try:
            if self._receive(message):
                self._over.set_result(None)
        except Exception as error:  # noqa: BLE001 - raised where it can be handled
            self._over.set_exception(error)

    async def _watch(self) -> None:
        """Raise once the other side is silent.

        The keepalive of websockets won't do: where the send buffer is full it waits without end to
        write its ping. And as a ping may stand behind much data on a slow line, any frame that
        comes in the meantime is a sign of life too.
        """
        answer_due = self._time() + self._timing.attach_timeout
        while True:
            await asyncio.sleep(self._timing.ping_interval)
            await self._check_alive()
            if not self._heard and self._time() > answer_due:
                message = f"no answer to attach for {self._timing.attach_timeout} s"
                raise LinkError("unreachable", message)

    async def _check_alive(self) -> None:
        started = self._time()
        ping = asyncio.ensure_future(self._ping())
        try:
            while not ping.done():
                patience = max(started, self._heard) + self._timing.ping_timeout - self._time()
                if patience <= 0:
                    message = f"no sign of the server for {self._timing.ping_timeout} s"
                    raise LinkError("disconnected", message)
                # Not wait_for: before Python 3.12 it can swallow a cancellation.
                await asyncio.wait([ping], timeout=patience)
            ping.result()
        finally:
            ping.cancel()
            await asyncio.gather(ping, return_exceptions=True)

    async def _ping(self) -> None:
        await (await self._socket.ping())
