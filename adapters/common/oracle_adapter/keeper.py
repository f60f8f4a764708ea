"""The link's thread: it connects, and connects again until there is nothing left to send."""

from __future__ import annotations

import asyncio
import random
import threading
import time
from typing import TYPE_CHECKING, Iterator, Optional, Sequence

from oracle_adapter import logs
from oracle_adapter.connection import FAILURES, ClosedError, Conversation, open_connection
from oracle_adapter.errors import LinkError
from oracle_adapter.route import Route

if TYPE_CHECKING:
    from oracle_adapter.connection import Address, Timing
    from oracle_adapter.exchange import Exchange


_OFTEN = 0.8
"""Seconds between two rounds at the most, where another server may take over at any time."""
READY_WITHIN = 10.0
"""Seconds that the thread may take until it is ready to connect."""


class Keeper:
    """One thread with a loop of its own, from `start` to `stop`."""

    def __init__(self, addresses: Sequence[Address], timing: Timing, exchange: Exchange) -> None:
        self._route = Route(addresses, time.monotonic)
        self._timing, self._exchange = timing, exchange
        self._conversation: Optional[Conversation] = None  # the latest
        self._work: Optional[asyncio.Future[None]] = None
        self._thread = threading.Thread(target=self._run, name="oracle-link", daemon=True)

    def start(self) -> None:
        """Start the thread, once; raises `LinkError` where it does not get ready."""
        if self._thread.ident is not None:
            raise RuntimeError("a link starts once")
        try:
            self._thread.start()
        except RuntimeError as error:
            self._exchange.end(_failed(error))
        try:
            self._exchange.wait_opened(READY_WITHIN)
        except LinkError as error:
            self._exchange.end(error)
            raise

    def stop(self, timeout: float) -> bool:
        """Detach and end the thread, after `timeout` seconds anyway; True where it detached."""
        if threading.current_thread() is self._thread:
            raise RuntimeError("a callback of the link can't close it")
        self._exchange.detach()
        if self._thread.ident is None:
            self._exchange.end(_closed())
            return False
        self._exchange.call_soon(self._hurry)
        self._thread.join(timeout)
        self._exchange.call_soon(self._cancel)
        self._thread.join(self._timing.close_timeout)  # only a callback that hangs takes longer
        return self._exchange.detached

    def _run(self) -> None:
        main = self._main()
        try:
            asyncio.run(main)
        except Exception as error:  # noqa: BLE001 - those who wait for the thread get it
            main.close()
            self._exchange.end(_failed(error))

    async def _main(self) -> None:
        self._closing = asyncio.get_running_loop().create_future()
        self._work = asyncio.ensure_future(self._keep_up())
        self._exchange.open(asyncio.get_running_loop(), self._pump)
        end = _closed()
        try:
            await self._work
        except asyncio.CancelledError:
            pass  # stop has waited long enough
        except LinkError as error:
            end = error
            self._exchange.report(error)
        except Exception as error:  # noqa: BLE001 - asks are answered in any case
            logs.failure("the link failed")
            end = _failed(error)
            self._exchange.report(end)
        finally:
            self._exchange.end(end)

    async def _keep_up(self) -> None:
        """Raise the `LinkError` after which another connection is useless."""
        delays, clock = self._delays(), asyncio.get_running_loop().time
        name_due = clock() + self._timing.name_timeout
        while not self._exchange.done:
            began, url = clock(), self._route.address.shown
            try:
                await self._connect()
                continue
            except LinkError as failure:
                error = failure
                if failure.code == "monitor_taken" and clock() < name_due:
                    failure.fatal = False
                at_once = self._move(failure)
            except FAILURES as failure:
                code = "disconnected" if self._exchange.attached else "unreachable"
                message = str(failure) or "timed out"
                error = LinkError(code, f"{url}: {message}")
                at_once = self._move(failure)
            if not at_once or self._exchange.attached:  # else there may be a better answer
                self._exchange.disconnected(error)
            if (
                clock() - began > self._timing.backoff_last
            ):  # the connection lasted: this is a new failure
                delays = self._delays()
            if error.fatal:
                raise error
            if not at_once:
                await self._pause(next(delays))

    def _move(self, failure: Exception) -> bool:
        """Choose the server that is tried next; returns whether to try it at once."""
        route = self._route
        if isinstance(failure, LinkError) and failure.code == "monitor_taken":
            return False  # here the name will be free
        if isinstance(failure, LinkError) and failure.code == "moved":
            if failure.url is not None and route.several and not route.knows(failure.url):
                failure.message += "; that is none of this monitor's servers"
            return route.refused(failure.url)
        if isinstance(failure, ClosedError):
            if self._exchange.attached:
                route.lost()
                return False
            if failure.told:
                return route.refused()
        return route.unreachable()

    async def _connect(self) -> None:
        socket = await open_connection(self._route.address, self._timing)
        exchange = self._exchange
        conversation = Conversation(
            socket, self._timing, receive=exchange.receive, next_frame=exchange.next_frame
        )
        self._conversation = conversation
        await conversation.run(exchange.hello())

    def _pump(self) -> None:
        if self._conversation is not None:
            self._conversation.pump()

    def _delays(self) -> Iterator[float]:
        delay = self._timing.backoff_first
        while True:
            yield delay * random.uniform(0.5, 1.0)  # noqa: S311 - no secret
            delay = min(2 * delay, _OFTEN if self._route.several else self._timing.backoff_last)

    def _cancel(self) -> None:
        if self._work is not None:
            self._work.cancel()

    def _hurry(self) -> None:
        if not self._closing.done():
            self._closing.set_result(None)

    async def _pause(self, seconds: float) -> None:
        """Wait, or until `stop` is called."""
        if self._closing.done():
            await asyncio.sleep(seconds)
        else:
            await asyncio.wait([self._closing], timeout=seconds)


def _failed(error: Exception) -> LinkError:
    return LinkError("internal", repr(error), fatal=True)


def _closed() -> LinkError:
    return LinkError("closed", "the link was closed")
