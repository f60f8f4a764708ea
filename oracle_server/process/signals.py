"""The signals by which a server is told to end."""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable


def when_told_to_end(act: Callable[[int], object]) -> None:
    """Have the event loop that runs call `act` with the number of each signal that tells a server to end.

    The first process of a container is deaf to what it does not handle. SIGHUP stays ignored where it is, as by
    `nohup`.
    """
    loop = asyncio.get_running_loop()
    for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
        if number != signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN:
            loop.add_signal_handler(number, act, number)
