"""One external oracle, a client of ROSMonitoring's protocol: each frame is one JSON event, and has one reply.

Replies do not identify their event. So only one question is open at a time, and a connection on which anything fails
is closed: a late reply can't be mistaken for the answer to another question.
"""

from __future__ import annotations

import asyncio
import contextlib

import structlog
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed, WebSocketException

from oracle_server.core.asking import Ask
from oracle_server.core.engine import Answer
from oracle_server.core.spec import SECOND, External
from oracle_server.core.verdicts import Outcome
from oracle_server.remote.address import UnreachableError, connected
from oracle_server.remote.replies import OtherEventError, read_reply
from oracle_server.wire.flat import as_flat
from oracle_server.wire.json import encode

_RETRY_AFTER = 1.0
"""Seconds before the next attempt to connect; until then questions fail at once."""

log = structlog.get_logger()


class ExternalOracle:
    """A connection to an oracle, with one question at a time; it reconnects where the connection is lost."""

    def __init__(self, external: External) -> None:
        """Make no connection yet: `ask` and `connect` do."""
        self.used = False
        """Whether it has received an event before, so that it may have lost its state on a new connection."""
        self.timeout = external.timeout / SECOND
        """Seconds that an answer may take."""
        self._external = external
        self._socket: ClientConnection | None = None
        self._retry_at, self._unreachable = 0.0, ""
        self._failing = False
        self._closing: set[asyncio.Task[None]] = set()

    async def ask(self, ask: Ask, until: float) -> Answer:
        """Ask the oracle about a step; its outcome is unknown if no reply arrives by `until` (the loop's time, s)."""
        name = ask.step.event.stream.name
        try:
            event = as_flat(ask.step, name.removeprefix("/") if self._external.bare else name, ask.time)
            text = encode(event)
        except (ValueError, TypeError, OverflowError, RecursionError) as error:
            return Answer(Outcome.UNKNOWN, f"could not be sent the event: {error}")
        try:
            async with asyncio.timeout_at(until):
                socket, anew = await self._connected()
                self.used = True
                await socket.send(text)
                answer = read_reply(await socket.recv(), event)._replace(anew=anew)
        except Exception as error:  # noqa: BLE001 -- after any error the answer is unknown
            return self._failed(self._reason(error))
        if self._failing:
            self._failing = False
            log.info("an oracle answers again", oracle=self._external.url)
        return answer

    async def connect(self, until: float) -> str | None:
        """Connect before the first question; returns why that failed, None where it is connected."""
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
        """A connection without unread frames, and whether the oracle may have lost its state, since it is new."""
        if self._socket is not None and not await self._is_quiet(self._socket):
            self._drop()
        if self._socket is not None:
            return self._socket, False
        self._socket = await self._connect()
        return self._socket, self.used

    async def _is_quiet(self, socket: ClientConnection) -> bool:
        """Whether a connection is open, and has no frame that would be mistaken for the next answer."""
        await asyncio.sleep(0)  # lets the connection read what has arrived
        try:
            async with asyncio.timeout(0):
                await socket.recv()
        except TimeoutError:
            return True
        except ConnectionClosed:
            return False
        log.warning("an oracle sent a reply without a question", oracle=self._external.url)
        return False

    async def _connect(self) -> ClientConnection:
        loop = asyncio.get_running_loop()
        if loop.time() < self._retry_at:
            raise UnreachableError(self._unreachable)
        self._retry_at, self._unreachable = loop.time() + self.timeout + _RETRY_AFTER, "it does not answer"
        try:
            socket = await connected(self._external.url)
        except (OSError, WebSocketException, ValueError, EOFError, UnreachableError) as error:
            self._retry_at, self._unreachable = loop.time() + _RETRY_AFTER, str(error) or type(error).__name__
            raise UnreachableError(self._unreachable) from None
        except Exception:
            log.exception("an oracle could not be connected to", oracle=self._external.url)
            self._retry_at, self._unreachable = loop.time() + _RETRY_AFTER, "see the server's log"
            raise UnreachableError(self._unreachable) from None
        self._retry_at = 0.0
        return socket

    def _reason(self, error: Exception) -> str:
        """Why there is no answer, as text."""
        match error:
            case TimeoutError():
                return f"did not answer within {self.timeout:g} s"
            case ConnectionClosed():
                return "closed the connection before it answered"
            case UnreachableError():
                return f"can't be reached: {error}"
            case OtherEventError():
                return "answered about another event"
        log.exception("an oracle could not be asked", oracle=self._external.url)
        return "could not be asked; see the server's log"

    def _failed(self, reason: str) -> Answer:
        self._drop()
        if not self._failing:
            self._failing = True
            log.warning("an oracle fails", oracle=self._external.url, reason=reason)
        return Answer(Outcome.UNKNOWN, reason)

    def _drop(self) -> None:
        """Close the connection in the background."""
        if self._socket is not None:
            closing = asyncio.get_running_loop().create_task(_close(self._socket))
            self._closing.add(closing)
            closing.add_done_callback(self._closing.discard)
        self._socket = None


async def _close(socket: ClientConnection) -> None:
    with contextlib.suppress(OSError, WebSocketException):
        await socket.close()
