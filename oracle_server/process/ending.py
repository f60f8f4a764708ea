"""Ending a command in good order where it is told to end."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_NAMES = "SIGTERM", "SIGHUP"
_SOON = 0.01
"""Seconds after which a command that went on is told again."""


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Clean up, too, where this process is told to end, or its terminal is closed; for the main thread.

    Then it ends with the status that shells give to the signal. A signal that is ignored, as by `nohup`, stays so. One
    that comes while garbage is collected, by Ctrl-C too, is told again: Python drops what is raised in there.
    """
    numbers = [number for name in _NAMES if (number := getattr(signal, name, None)) is not None]
    taken = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    told: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        for other in taken:
            signal.signal(other, signal.SIG_IGN)  # what is being cleaned up is not interrupted again
        told.append(number)
        raise KeyboardInterrupt

    def dropped(args: UnraisableHookArgs) -> None:
        if not issubclass(args.exc_type, KeyboardInterrupt):
            others(args)
            return
        number = told[0] if told else signal.SIGINT
        if told:
            signal.signal(number, interrupt)
        threading.Timer(_SOON, _tell, [threading.get_ident(), number]).start()  # here it would be dropped again

    for number in taken:
        signal.signal(number, interrupt)
    others, sys.unraisablehook = sys.unraisablehook, dropped
    try:
        yield
    except KeyboardInterrupt:
        if told:
            raise SystemExit(128 + told[0]) from None
        raise
    finally:
        sys.unraisablehook = others
        for number in taken:
            signal.signal(number, signal.SIG_DFL)


def _tell(thread: int, number: int) -> None:
    """Send a signal to the main thread, which may wait for something."""
    if sys.platform == "win32":
        signal.raise_signal(number)
    else:
        signal.pthread_kill(thread, number)
