"""A link to an oracle in this very process: the same frames, without a socket or a server.

This module alone imports `oracle_server`, and only where a link is made: Python 3.11 or newer.
"""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Callable, Optional

from oracle_adapter import logs
from oracle_adapter.connection import Address, ClosedError, Timing
from oracle_adapter.errors import LinkError
from oracle_adapter.keeper import Keeper
from oracle_adapter.link import Link

if TYPE_CHECKING:
    from oracle_adapter.exchange import Exchange

_LEFT = "events may be judged or committed still, and are lost where this process ends before"
_NOT_HERE = "an embedded oracle needs Python 3.11 or newer and the package oracle-server"


class EmbeddedLink(Link):
    """A link that judges by the spec in a file, and keeps the history in a data directory.

    An ask is judged in the thread that asks, where nothing else is being judged, and its answer
    given there, or in a thread of the oracle where it is slow; all else is as for `Link`, whose
    arguments beside `url`, `spec`, `token` and `tls` it takes. `data_dir`: default that of
    `oracle-server`.
    """

    def __init__(
        self, spec: str, data_dir: Optional[str], monitor: str, wait: float = 0.0, **more: Any
    ) -> None:
        """Open the data directory. Raises `LinkError` where this can't be done.

        Another adapter that has it may be ending: it is waited for, for `wait` seconds at most.
        """
        self._oracle = _open(spec, data_dir, wait)
        try:
            super().__init__("ws://embedded", monitor, spec=self._oracle.spec, **more)
        except BaseException:
            self._oracle.stop(0)  # what another link in this process may want to open
            raise
        self._keeper = _Keeper(self._oracle, self._exchange)

    def start(self) -> None:
        """Restore the sessions that are open in the history, and begin to attach."""
        _try(self._oracle.start)
        super().start()

    def close(self, timeout: float = 5.0) -> bool:
        """As of any link; then commit all, and close the history, within `timeout` seconds more.

        What goes on after that is logged, and False returned; it ends with the process at last.
        """
        detached = stopped = False
        try:
            detached = super().close(timeout)
        finally:
            stopped = self._oracle.stop(timeout)
            if not stopped:
                logs.warn("the history is not closed after %g s: %s", timeout, _LEFT)
        return detached and stopped


def log_warnings() -> None:
    """Let an oracle in this process log warnings alone, to stderr: for a program of its own."""
    try:
        from oracle_server.embedded.oracle import log_warnings as begin
    except ImportError:
        return  # a link tells why
    begin()


def _open(spec: str, data_dir: Optional[str], wait: float) -> Any:
    if sys.version_info < (3, 11):
        here = ".".join(map(str, sys.version_info[:2]))
        raise LinkError("embedded", f"{_NOT_HERE}; this is Python {here}", fatal=True)
    try:
        from oracle_server.embedded.oracle import EmbeddedOracle
    except ImportError as error:
        raise LinkError("embedded", f"{_NOT_HERE}: {error}", fatal=True) from None
    folder = None if data_dir is None else Path(data_dir)
    return _try(lambda: EmbeddedOracle(Path(spec), folder, wait))


def _try(work: Callable[[], Any]) -> Any:
    """Do something with the oracle; raises `LinkError` where it can't be done."""
    from oracle_server.core.errors import OracleError

    try:
        return work()
    except OracleError as error:
        raise LinkError("embedded", str(error), fatal=True) from None


class _Keeper(Keeper):
    """Attaches to the oracle of this process; its thread has the deadlines, and never judges."""

    def __init__(self, oracle: Any, exchange: Exchange) -> None:
        super().__init__([Address("ws://embedded")], Timing(), exchange)
        self._oracle = oracle
        self._line: Any = None
        exchange.judge_at_once(self._bring, self._pump)

    async def _connect(self) -> None:
        from oracle_server.embedded.line import Ends

        loop = asyncio.get_running_loop()
        over: asyncio.Future[None] = loop.create_future()
        exchange = self._exchange

        def end(error: Optional[BaseException]) -> None:
            if over.done():
                return
            if error is None:
                over.set_result(None)
            else:
                over.set_exception(error)

        def receive(frame: bytes) -> None:
            try:
                if exchange.receive(frame):
                    _soon(loop, end, None)
            except Exception as error:  # noqa: BLE001 - raised where it can be handled
                _soon(loop, end, error)

        def closed(why: str) -> None:
            _soon(loop, end, ClosedError(why, told=True))

        line = self._oracle.connect(Ends(receive, self._pump, closed), exchange.hello())
        self._line = line
        self._pump()  # it may have been greeted before there was a line
        try:
            await over
        finally:
            self._line = None
            line.hang_up()

    def _bring(self) -> None:
        """Let the session take what is queued, in this thread; in the oracle's where it is busy."""
        line = self._line
        if line is not None:
            line.bring(self._exchange.next_frame)

    def _pump(self) -> None:
        """Let it be taken in the oracle's thread: this one does not wait."""
        line = self._line
        if line is not None:
            line.bring_later(self._exchange.next_frame)


def _soon(loop: asyncio.AbstractEventLoop, call: Callable[..., None], *arguments: Any) -> None:
    try:
        loop.call_soon_threadsafe(call, *arguments)
    except RuntimeError:  # the link's thread has ended
        logs.warn("%s", arguments[0] or "the link has ended")
