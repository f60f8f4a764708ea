"""One oracle elsewhere that speaks ROSMonitoring's protocol: one JSON event a frame, and one reply to each, in order.

Replies carry nothing that tells whose they are. So one question at a time is under way, and a connection on which
anything went wrong is given up: what still comes on it can't be taken for the answer to another question.
"""

from __future__ import annotations

import asyncio
import contextlib

import structlog
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.errors import OracleError
from oracle_server.core.spec import SECOND, External
from oracle_server.core.verdicts import Outcome
from oracle_server.remote.replies import OtherEventError, read_reply
from oracle_server.wire.flat import as_flat
from oracle_server.wire.json import encode

_RETRY_AFTER = 1.0
"""Seconds after which an oracle that could not be reached is tried again; until then nothing waits for it."""
_CLOSE_WITHIN = 1.0
_MAX_REPLY = 2**20

log = structlog.get_logger()


class UnreachableError(OracleError):
    """No connection can be made at present."""


class ExternalOracle:
    """A connection to an oracle, made anew where it is lost; one question at a time."""

    def __init__(self, asked: External) -> None:
        """Connect when there is something to ask, or by `connect`."""
        self.begun = False
        """Whether it was ever told of an event, so that a new connection may find it as it was at its beginning."""
        self.timeout = asked.timeout / SECOND
        """Seconds that an answer may take."""
        self._asked = asked
        self._socket: ClientConnection | None = None
        self._retry_at, self._unreachable = 0.0, ""
        self._away = False
        self._closing: set[asyncio.Task[None]] = set()

    async def ask(self, ask: Ask, until: float) -> Answer:
        """What the oracle says of a step; unknown where it says nothing until then, a time of the event loop's."""
        name = ask.step.event.stream.name
        try:
            event = as_flat(ask.step, name.removeprefix("/") if self._asked.bare else name, ask.time)
            text = encode(event)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            return Answer(Outcome.UNKNOWN, f"could not be told of the event: {error}")
        try:
            async with asyncio.timeout_at(until):
                socket, anew = await self._connected()
                self.begun = True
                await socket.send(text)
                answer = read_reply(await socket.recv(), event)._replace(anew=anew)
        except Exception as error:  # noqa: BLE001 -- whatever it is, the answer is not known
            return self._failed(self._reason(error))
        if self._away:
            self._away = False
            log.info("an oracle answers again", oracle=self._asked.url)
        return answer

    async def connect(self, until: float) -> str | None:
        """Be connected before there is anything to ask; why that can't be, None where it is."""
        try:
            async with asyncio.timeout_at(until):
                await self._connected()
        except TimeoutError:
            return f"can't be reached within {self.timeout:g} s"
        except UnreachableError as error:
            return f"can't be reached: {error}"
        return None

    async def close(self) -> None:
        """Close the connection, within a second."""
        self._drop()
        await asyncio.gather(*self._closing, return_exceptions=True)

    async def _connected(self) -> tuple[ClientConnection, bool]:
        """A connection on which nothing is to be heard, and whether the oracle may have begun anew with it."""
        if self._socket is not None and not await self._is_quiet(self._socket):
            self._drop()
        if self._socket is not None:
            return self._socket, False
        self._socket = await self._connect()
        return self._socket, self.begun

    async def _is_quiet(self, socket: ClientConnection) -> bool:
        """Whether a connection is open, and holds nothing that would be taken for the next answer."""
        await asyncio.sleep(0)  # let what has come be read
        try:
            async with asyncio.timeout(0):
                await socket.recv()
        except TimeoutError:
            return True
        except ConnectionClosed:
            return False
        log.warning("an oracle spoke without being asked", oracle=self._asked.url)
        return False

    async def _connect(self) -> ClientConnection:
        loop = asyncio.get_running_loop()
        if loop.time() < self._retry_at:
            raise UnreachableError(self._unreachable)
        self._retry_at, self._unreachable = loop.time() + self.timeout + _RETRY_AFTER, "it does not answer"
        try:
            socket = await connect(
                self._asked.url, proxy=None, compression=None, open_timeout=None, close_timeout=_CLOSE_WITHIN,
                ping_interval=None, max_size=_MAX_REPLY,
            )  # fmt: skip
        except (OSError, WebSocketException, ValueError, EOFError) as error:
            self._retry_at, self._unreachable = loop.time() + _RETRY_AFTER, str(error) or type(error).__name__
            raise UnreachableError(self._unreachable) from None
        except Exception:
            log.exception("an oracle could not be connected to", oracle=self._asked.url)
            self._retry_at, self._unreachable = loop.time() + _RETRY_AFTER, "the server's log says why"
            raise UnreachableError(self._unreachable) from None
        self._retry_at = 0.0
        return socket

    def _reason(self, error: Exception) -> str:
        """Why there is no answer, in words."""
        match error:
            case TimeoutError():
                return f"did not answer within {self.timeout:g} s"
            case ConnectionClosed():
                return "closed the connection before it answered"
            case UnreachableError():
                return f"can't be reached: {error}"
            case OtherEventError():
                return "answered about another event"
        log.exception("an oracle could not be asked", oracle=self._asked.url)
        return "could not be asked; the server's log says why"

    def _failed(self, reason: str) -> Answer:
        self._drop()
        if not self._away:
            self._away = True
            log.warning("an oracle fails", oracle=self._asked.url, reason=reason)
        return Answer(Outcome.UNKNOWN, reason)

    def _drop(self) -> None:
        """Give the connection up; its close is not waited for."""
        if self._socket is not None:
            closing = asyncio.get_running_loop().create_task(_close(self._socket))
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
        self._socket = None


async def _close(socket: ClientConnection) -> None:
    with contextlib.suppress(OSError, WebSocketException):
        await socket.close()
