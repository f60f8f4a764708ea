"""The end of the adapter, as signals ask for it: at once where it waits for the master, which may hang."""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import contextmanager
from typing import Iterator

ASK_AGAIN = 0.2
"""Seconds after which the main thread is interrupted once more: Python ignores what is raised within a destructor."""


class Stopping(threading.Event):
    """Set once the adapter is to end; takes SIGALRM, too."""

    def __init__(self) -> None:
        """Be set by SIGINT, SIGTERM and SIGHUP, from now on; to be made in the main thread."""
        super().__init__()
        self._asking = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:  # as by `nohup`
                signal.signal(number, lambda *_: self._asked())
        signal.signal(signal.SIGALRM, lambda *_: self._interrupt())
        tell = sys.unraisablehook
        sys.unraisablehook = lambda ignored: None if ignored.exc_type is SystemExit else tell(ignored)

    @contextmanager
    def asking_master(self) -> Iterator[None]:
        """Around what the master must answer: there a signal raises SystemExit, in the main thread."""
        self._asking = True
        try:
            if self.is_set():
                sys.exit(0)
            yield
        finally:
            self.calm()

    def calm(self) -> None:
        """Raise nothing more: to be called before what must not be interrupted.

        A signal that comes between the last statement within `asking_master` and its end would else raise again.
        """
        self._asking = False
        signal.setitimer(signal.ITIMER_REAL, 0)  # else it would kill a Python that has begun to end

    def _asked(self) -> None:
        self.set()
        self._interrupt()

    def _interrupt(self) -> None:
        if self._asking:
            signal.setitimer(signal.ITIMER_REAL, ASK_AGAIN)
            sys.exit(0)
