"""One WebSocket connection: it transfers frames, whatever they mean."""

from __future__ import annotations

import asyncio
import os
import re
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterator, List, Optional
from urllib.parse import SplitResult, urlsplit, urlunsplit

from websockets.exceptions import WebSocketException

from oracle_adapter.answers import in_words
from oracle_adapter.errors import LinkError
from oracle_adapter.lookup import addresses
from oracle_adapter.tls import Renewed
from oracle_adapter.websocket import SWITCHING, WebSocket

if TYPE_CHECKING:
    from ssl import SSLContext

PATH = "/api/v1/attach"
UNIX = "unix://"
"""How the address of a UNIX socket begins; the rest is its path."""
MAX_MESSAGE = 1 << 26
"""Bytes of a frame from the server: a violation carries its events."""
_AT_ONCE = 1 << 14
"""Bytes that are written in one go, or one frame: a ping waits behind them."""
REFUSALS = {401: "unauthorized", 403: "forbidden", 421: "misdirected"}
"""HTTP statuses that another attempt does not change."""
FAILURES = (OSError, asyncio.TimeoutError, WebSocketException)
"""What a connection that fails raises."""


@dataclass(frozen=True)
class Timing:
    """The link's time limits, in seconds.

    A connection on which nothing comes for `ping_interval + ping_timeout` is given up. The time
    between attempts doubles from `backoff_first` to `backoff_last`, each shortened at random by up
    to a half. For `name_timeout` from its start the link waits for its name, where another process
    that is attached by it may be ending.
    """

    open_timeout: float = 3.0
    attach_timeout: float = 10.0
    ping_interval: float = 1.0
    ping_timeout: float = 2.0
    close_timeout: float = 1.0
    backoff_first: float = 0.1
    backoff_last: float = 2.0
    name_timeout: float = 10.0


@dataclass(frozen=True)
class Address:
    """The oracle's address and what it requires; `url` is as `attach_url` returns it."""

    url: str
    token: Optional[str] = None
    tls: Optional[Callable[[], SSLContext]] = None
    """Gives what the next connection is encrypted by."""

    @property
    def shown(self) -> str:
        """The address for people, without the password that may be in it, or what may be one."""
        return self.url if self.url.startswith(UNIX) else re.sub("//.*@", "//", self.url)


def addresses_of(urls: str, token: Optional[str], tls: Optional[SSLContext]) -> List[Address]:
    """The addresses of servers that are separated by commas; all get the token.

    Those that are encrypted are reached by `tls`, or by what the environment names without one.
    Raises `ValueError`.
    """
    token = _trimmed(token)
    found = [attach_url(url.strip()) for url in urls.split(",")]
    plain = [url for url in found if not url.startswith("wss:")]
    if tls is not None and plain:
        raise ValueError(f"tls needs a wss:// or https:// address, not {Address(plain[0]).shown!r}")
    if len(plain) == len(found):
        return [Address(url, token) for url in found]
    context = Renewed(os.environ).context if tls is None else lambda: tls
    return [Address(url, token, None if url in plain else context) for url in found]


def _trimmed(token: Optional[str]) -> Optional[str]:
    """A token without the space around it, as files have it at their end.

    Raises `ValueError`, without the token, where no header could hold it.
    """
    trimmed = token.strip() if token else token
    if trimmed and not all("!" <= character <= "~" for character in trimmed):
        raise ValueError("the token is none; `oracle-server token add` prints one")
    return trimmed


def attach_url(url: str) -> str:
    """The address for a server given as `ws://`, `wss://`, `http://`, `https://` or `unix:///PATH`.

    That of a UNIX socket is as given, all others are those of a WebSocket. Raises `ValueError`.
    """
    if url.startswith(UNIX):
        if not url.startswith(UNIX + "/"):
            raise _no_address(url, "unix:///run/oracle/oracle.sock")
        return url
    try:
        parts = urlsplit(url)
    except ValueError:  # its text may have the password
        raise _no_address(url) from None
    scheme = {"ws": "ws", "http": "ws", "wss": "wss", "https": "wss"}.get(parts.scheme)
    if scheme is None or not _is_host(parts.hostname):
        raise _no_address(url)
    if not _has_port(parts):  # it is not shown: it may be what a password has before its `/`
        raise ValueError(f"the port of {parts.hostname} is none from 1 to 65535")
    path = parts.path.rstrip("/")
    path = path if path.endswith(PATH) else path + PATH
    return urlunsplit((scheme, parts.netloc, path, parts.query, ""))


def _no_address(url: str, like: str = "ws://127.0.0.1:8642") -> ValueError:
    shown = re.sub(r"^([a-z]+://)?.*@", r"\1", url)  # without what may be a password
    return ValueError(f"{shown!r} is no address like {like}")


def _has_port(parts: SplitResult) -> bool:
    """Whether there is a port that can be, or none, as where it is the scheme's."""
    try:
        return parts.port != 0
    except ValueError:
        return False


def _is_host(name: Optional[str]) -> bool:
    """Whether a name can be looked up: `robot..local` can't, nor what has 64 letters and no dot."""
    try:
        return bool((name or "").encode("idna"))
    except UnicodeError:
        return False


async def open_connection(address: Address, timing: Timing) -> WebSocket:
    """Open a WebSocket; raises a fatal `LinkError` where it is refused, or one of `FAILURES`."""
    by_path = address.url.startswith(UNIX)
    url = f"ws://localhost{PATH}" if by_path else address.url
    socket = WebSocket(url, "oracle.v1", _headers(address.token), MAX_MESSAGE)
    opening = asyncio.ensure_future(_open(socket, address))
    with ExitStack() as undo:
        undo.callback(socket.abort)
        undo.callback(opening.cancel)
        await asyncio.wait([opening], timeout=timing.open_timeout)  # not wait_for: see below
        if not opening.done():
            raise asyncio.TimeoutError(f"no answer within {timing.open_timeout} s")
        opening.result()
        undo.pop_all()
    return socket


async def _open(socket: WebSocket, address: Address) -> None:
    loop = asyncio.get_running_loop()
    if address.url.startswith(UNIX):
        await loop.create_unix_connection(lambda: socket, address.url[len(UNIX) :])
    else:
        parts = urlsplit(address.url)
        secure = parts.scheme == "wss"
        host, port = parts.hostname or "", parts.port or (443 if secure else 80)
        tls = address.tls() if address.tls else secure or None
        await _connect(loop, socket, host, port, tls)
    answer = await socket.opened()
    status = answer.status_code
    if status in REFUSALS:
        message = f"{address.shown} answered {in_words(answer)}"
        raise LinkError(REFUSALS[status], message, fatal=True)
    if status != SWITCHING:
        raise ConnectionError(f"the answer is {in_words(answer)}")


async def _connect(
    loop: asyncio.AbstractEventLoop, socket: WebSocket, host: str, port: int, tls: Any
) -> None:
    """Connect to the first of a host's addresses that answers."""
    name = host if tls else None
    *others, last = await addresses(host, port)
    for one in others:
        with suppress(OSError):
            await loop.create_connection(lambda: socket, one, port, ssl=tls, server_hostname=name)
            return
    await loop.create_connection(lambda: socket, last, port, ssl=tls, server_hostname=name)


def _headers(token: Optional[str]) -> Dict[str, str]:
    return {"Authorization": f"Bearer {token}"} if token else {}


class ClosedError(ConnectionError):
    """A connection that was open has ended; `told` is whether the other side has said so before."""

    def __init__(self, why: str, *, told: bool) -> None:
        super().__init__(why)
        self.told = told


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
        self._answered = False
        self._over: asyncio.Future[None] = loop.create_future()  # the last frame, or what failed

    async def run(self, hello: str) -> None:
        """Return after the last frame and a close in order; raise where it ends otherwise."""
        socket = self._socket
        socket.on_message, socket.on_room = self._take, self.pump
        socket.write([hello])
        watching = asyncio.ensure_future(self._watch())
        ends: List[asyncio.Future[Any]] = [self._over, socket.closed, watching]
        try:
            await asyncio.wait(ends, return_when=asyncio.FIRST_COMPLETED)
            if self._over.done():
                self._over.result()
                await socket.close(self._timing.close_timeout)
            elif socket.closed.done():
                raise ClosedError(socket.closed.result(), told=socket.told)
            else:
                watching.result()
        finally:
            self._over.cancel()  # later frames are ignored
            # A closing handshake would wait for unsent bytes, though the other side may be gone.
            socket.abort()
            watching.cancel()
            await asyncio.gather(watching, return_exceptions=True)

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
        self._answered = True
        try:
            if self._receive(message):
                self._over.set_result(None)
        except Exception as error:  # noqa: BLE001 - raised where it can be handled
            self._over.set_exception(error)

    async def _watch(self) -> None:
        """Raise where nothing comes from the other side.

        A ping may be queued after much data on a slow line, so anything that comes in the meantime
        counts as an answer.
        """
        answer_due = self._time() + self._timing.attach_timeout
        while True:
            await asyncio.sleep(self._timing.ping_interval)
            await self._check_alive()
            if not self._answered and self._time() > answer_due:
                message = f"no answer to attach for {self._timing.attach_timeout} s"
                raise LinkError("unreachable", message)

    async def _check_alive(self) -> None:
        self._socket.heard.clear()
        self._socket.ping()
        heard = asyncio.ensure_future(self._socket.heard.wait())
        try:
            # Not wait_for: before Python 3.12 it can swallow a cancellation.
            await asyncio.wait([heard], timeout=self._timing.ping_timeout)
            if not heard.done():
                message = f"no sign of the server for {self._timing.ping_timeout} s"
                raise LinkError("disconnected", message)
        finally:
            heard.cancel()
