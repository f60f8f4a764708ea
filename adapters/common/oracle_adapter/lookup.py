"""The addresses of a host's name, looked up by a thread for which no end of the process waits.

Where no nameserver answers that takes ten seconds and more, and asyncio's threads are waited for.
"""

from __future__ import annotations

import asyncio
import socket
import threading
from contextlib import suppress
from typing import Any, Callable, List


async def addresses(host: str, port: int) -> List[str]:
    """All addresses of a host, in the order in which they are to be tried. Raises OSError."""
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[List[str]] = loop.create_future()

    def settle(how: Callable[[Any], None], what: Any) -> None:
        if not answer.done():  # it may be too late
            how(what)

    def look_up() -> None:
        how: Callable[[Any], None] = answer.set_result
        what: Any
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            what = list(dict.fromkeys(_text(each[4]) for each in found))
        except Exception as error:  # noqa: BLE001 - raised where it is waited for
            how, what = answer.set_exception, error
        with suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(settle, how, what)

    threading.Thread(target=look_up, name="oracle-lookup", daemon=True).start()
    return await answer


def _text(address: Any) -> str:
    """An address by itself, which the interface belongs to where it is of one alone."""
    scope = address[3] if len(address) > 3 else 0
    return f"{address[0]}%{scope}" if scope else str(address[0])
