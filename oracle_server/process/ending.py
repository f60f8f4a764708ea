"""Ending a command in good order where it is told to end."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
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
    ending = _Ending([number for number in numbers if signal.getsignal(number) is signal.SIG_DFL])
    by_ctrl_c, sys.unraisablehook = signal.getsignal(signal.SIGINT), ending.drop
    for number in ending.taken:
        signal.signal(number, ending.interrupt)
    try:
        yield
    except KeyboardInterrupt:
        if ending.told is not None:
            raise SystemExit(128 + ending.told) from None
        raise
    finally:
        ending.is_over = True
        sys.unraisablehook = ending.others
        signal.signal(signal.SIGINT, by_ctrl_c)
        for number in ending.taken:
            signal.signal(number, signal.SIG_DFL)


class _Ending:
    """What has been told by signals, and whether the main thread was interrupted by it."""

    def __init__(self, taken: Sequence[int]) -> None:
        """Take these signals, which nobody ignores."""
        self.taken, self.others = taken, sys.unraisablehook
        self.told: int | None = None
        self.is_over = False

    def interrupt(self, number: int, frame: FrameType | None) -> None:
        """Interrupt the main thread, unless Python would drop that: then it is told again."""
        if self._drops(frame):
            return
        for other in self.taken:
            signal.signal(other, signal.SIG_IGN)  # what is being cleaned up is not interrupted again
        self.told = number if number in self.taken else self.told
        self.is_over = True
        raise KeyboardInterrupt

    def drop(self, args: UnraisableHookArgs) -> None:
        """Have the main thread interrupted anew where it is that which Python drops."""
        if not issubclass(args.exc_type, KeyboardInterrupt):
            self.others(args)
            return
        number = signal.SIGINT if self.told is None else self.told
        self.is_over = False
        signal.signal(number, self.interrupt)
        threading.Thread(target=self._tell, args=(threading.get_ident(), number), daemon=True).start()

    def _drops(self, frame: FrameType | None) -> bool:
        """Whether what is raised at a frame is dropped, as it is within `drop`."""
        while frame is not None and frame.f_code is not _Ending.drop.__code__:
            frame = frame.f_back
        return frame is not None

    def _tell(self, thread: int, number: int) -> None:
        """Send a signal to the main thread, which may wait for something, until that is interrupted."""
        while True:
            time.sleep(_SOON)
            if self.is_over:
                return
            if sys.platform == "win32":
                signal.raise_signal(number)
            else:
                signal.pthread_kill(thread, number)
