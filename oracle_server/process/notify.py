"""Notifications of this process's state to systemd or `oracle-server start`, by the protocol of sd_notify(3)."""

from __future__ import annotations

import contextlib
import os
import socket

VARIABLE = "NOTIFY_SOCKET"
READY = "READY=1"
STATUS = "STATUS="
"""Before a text for people, of one line: `systemctl status` and `oracle-server start` show it."""
_SEND_WITHIN = 0.5
"""Seconds that sending may take; the event loop is blocked meanwhile."""


def notify(state: str) -> None:
    """Send a state such as `READY=1`; without effect where nothing listens, or does not receive in `_SEND_WITHIN`."""
    address = os.environ.get(VARIABLE)
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.settimeout(_SEND_WITHIN)
        sender.sendto(state.encode(), address)


def watchdog_interval() -> float | None:
    """Seconds between two `WATCHDOG=1` (half the time that systemd allows), None where systemd does not watch."""
    wanted = os.environ.get("WATCHDOG_USEC", "")
    return int(wanted) / 1e6 / 2 if wanted.isdecimal() and int(wanted) else None
