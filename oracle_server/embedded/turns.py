"""An event loop whose state other threads may use while it waits: they take turns by one lock."""

from __future__ import annotations

import asyncio
import selectors
import threading
import time
from asyncio import _get_running_loop, _set_running_loop  # which asyncio exports for event loops
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import Context
from typing import Any


class _Waiting(selectors.DefaultSelector):
    """A selector that lets go of a lock while it waits."""

    def __init__(self, lock: threading.Lock) -> None:
        super().__init__()
        self._lock = lock
        self.before: Callable[[], None] = _nothing
        """Called before it waits, without the lock."""
        self.until = 0.0
        """Until when it waits at most, by the monotonic clock."""

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        self.until = float("inf") if timeout is None else time.monotonic() + timeout
        self._lock.release()
        try:
            self.before()
            return super().select(timeout)
        finally:
            self._lock.acquire()


class TurnsLoop(asyncio.SelectorEventLoop):
    """Runs under its lock, but for the time that it waits; `turn` lends it to another thread then."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self._waiting = _Waiting(self.lock)
        self._hurry = False
        super().__init__(self._waiting)

    def before_waiting(self, call: Callable[[], None]) -> None:
        """Call something in the loop's thread before it waits, and without the lock; it must not raise."""
        self._waiting.before = call

    def run_forever(self) -> None:
        """Run until `stop`, under the lock."""
        with self.lock:
            super().run_forever()

    def call_from_anywhere(self, callback: Callable[..., object], *args: Any) -> None:
        """As `call_soon_threadsafe`; nothing where the loop is closed."""
        with suppress(RuntimeError):
            self.call_soon_threadsafe(callback, *args)

    @contextmanager
    def turn(self, within: float) -> Iterator[bool]:
        """Have the loop in this thread, as if it ran here; yields False where it is not free `within` so many seconds.

        Not to be used in the loop's own thread, nor inside itself.
        """
        if not self.lock.acquire(timeout=within):
            yield False
            return
        own = _get_running_loop()  # the caller may be in another loop
        _set_running_loop(None)
        _set_running_loop(self)
        self._hurry = False
        try:
            yield True
        finally:
            _set_running_loop(own)
            hurry = self._hurry
            self.lock.release()
            if hurry:
                self.call_soon_threadsafe(_nothing)

    def call_soon(  # type: ignore[override]
        self, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.Handle:
        """As of any loop; where it is lent, it need not wait any longer."""
        self._hurry = True
        return super().call_soon(callback, *args, context=context)

    def call_at(  # type: ignore[override]
        self, when: float, callback: Callable[..., object], *args: Any, context: Context | None = None
    ) -> asyncio.TimerHandle:
        """As of any loop; where it is lent, it waits no longer than until then."""
        self._hurry = self._hurry or when < self._waiting.until
        return super().call_at(when, callback, *args, context=context)


def _nothing() -> None:
    pass
