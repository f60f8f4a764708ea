"""Responses, which are sent again where the middleware had not discovered yet who waits for them.

It looks for the client's reader for 0.1 s, and sends nothing where there is none. rclpy warns of that, and no more: the
client would wait for ever.
"""

from __future__ import annotations

import threading
import warnings
from contextlib import suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.logging import get_logger

TRIES = 20
_UNSENT = "failed to send response"
_last = threading.local()
_show = warnings.showwarning


def send(service: Any, response: Any, header: Any) -> None:
    """Send a response, from any thread; where the service was destroyed its client gets none."""
    for _ in range(TRIES):
        _last.unsent = False
        with suppress(InvalidHandle):
            service.send_response(response, header)
        if not _last.unsent:
            return
    get_logger("oracle").error(f"a client of {service.srv_name} gets no response: it is not discovered")


def _note(message: Any, *rest: Any, **more: Any) -> None:
    if str(message).startswith(_UNSENT):
        _last.unsent = True
    else:
        _show(message, *rest, **more)


warnings.filterwarnings("always", message=_UNSENT)
warnings.showwarning = _note
