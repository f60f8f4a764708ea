"""One WebSocket connection: it moves frames and knows nothing of what they mean."""

from __future__ import annotations

import asyncio
import inspect
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Coroutine, Dict, Optional, Union
from urllib.parse import urlsplit, urlunsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus, WebSocketException
from websockets.typing import Subprotocol

from oracle_adapter.errors import LinkError

if TYPE_CHECKING:
    from ssl import SSLContext

PATH = "/api/v1/attach"
MAX_MESSAGE = 1 << 26
"""Bytes of a frame from the server: a violation carries its events."""
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


async def open_connection(address: Address, timing: Timing) -> ClientConnection:
    """Open a WebSocket; raises a fatal `LinkError` where it is refused, or one of `FAILURES`."""
    options: Dict[str, Any] = {} if address.tls is None else {"ssl": address.tls}
    # An oracle is on the robot's own network: the version for Python 3.8 knows no proxies, and the
    # newer ones shall not look for one either.
    if "proxy" in inspect.signature(connect.__init__).parameters:
        options["proxy"] = None
    try:
        return await connect(
            address.url,
            subprotocols=[Subprotocol("oracle.v1")],
            additional_headers=_headers(address.token),
            compression=None,
            open_timeout=timing.open_timeout,
            close_timeout=timing.close_timeout,
            ping_interval=None,  # Conversation pings: see there
            max_size=MAX_MESSAGE,
            **options,
        )
    except InvalidStatus as error:
        status = error.response.status_code
        if status in REFUSALS:
            message = f"{address.url} answered HTTP {status}"
            raise LinkError(REFUSALS[status], message, fatal=True) from error
        raise


def _headers(token: Optional[str]) -> Dict[str, str]:
    return {"Authorization": f"Bearer {token}"} if token else {}


async def _until_closed(work: Coroutine[Any, Any, None]) -> None:
    """Leave it to the reader to find the connection closed: it has frames to read until then."""
    with suppress(ConnectionClosed):
        await work
    await asyncio.Event().wait()


class Conversation:
    """Frames to and fro on one connection.

    `receive` takes each frame and says whether it was the last; `next_frame` gives the next one to
    write or None, and is asked again whenever `woken` is set.
    """

    def __init__(
        self,
        socket: ClientConnection,
        timing: Timing,
        *,
        receive: Callable[[Union[str, bytes]], bool],
        next_frame: Callable[[], Optional[str]],
        woken: asyncio.Event,
    ) -> None:
        self._socket, self._timing = socket, timing
        self._receive, self._next_frame, self._woken = receive, next_frame, woken
        self._time = asyncio.get_running_loop().time
        self._heard = 0.0  # when the last frame came

    async def run(self, hello: str) -> None:
        """Return after the last frame and a close in order; raise where it ends otherwise."""
        parts = (self._read(), _until_closed(self._write(hello)), _until_closed(self._watch()))
        tasks = [asyncio.ensure_future(part) for part in parts]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in tasks:
                if task.done():
                    task.result()
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._socket.close(), self._timing.close_timeout)
        finally:
            # Closing in order would wait for bytes to leave that no one may be there to take.
            self._socket.transport.abort()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _read(self) -> None:
        while not self._receive(await self._socket.recv()):
            self._heard = self._time()

    async def _write(self, hello: str) -> None:
        await self._socket.send(hello)
        while True:
            self._woken.clear()
            for frame in iter(self._next_frame, None):
                await self._socket.send(frame)
            await self._woken.wait()

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
