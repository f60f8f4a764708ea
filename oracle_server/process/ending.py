"""Ending a command in good order where it is told to end."""

from __future__ import annotations

import contextlib
import signal
from collections.abc import Iterator
from types import FrameType

_NAMES = "SIGTERM", "SIGHUP"


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """Clean up, too, where this process is told to end, or its terminal is closed; for the main thread.

    Then it ends with the status that shells give to the signal. A signal that is ignored, as by `nohup`, stays so.
    """
    numbers = [number for name in _NAMES if (number := getattr(signal, name, None)) is not None]
    taken = [number for number in numbers if signal.getsignal(number) is signal.SIG_DFL]
    told: list[int] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        for other in taken:
            signal.signal(other, signal.SIG_IGN)  # what is being cleaned up is not interrupted again
        told.append(number)
        raise KeyboardInterrupt

    for number in taken:
        signal.signal(number, interrupt)
    try:
        yield
    except KeyboardInterrupt:
        if told:
            raise SystemExit(128 + told[0]) from None
        raise
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)
