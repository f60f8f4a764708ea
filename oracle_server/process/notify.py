"""Tells whoever started this process how it stands, as sd_notify(3) has it: systemd, or `oracle-server start`."""

from __future__ import annotations

import contextlib
import os
import socket

VARIABLE = "NOTIFY_SOCKET"
_PATIENCE = 0.5
"""Seconds for which one who is behind with listening is waited for: all else stands still meanwhile."""


def notify(state: str) -> None:
    """Send a state such as `READY=1`; nothing where nobody listens, or takes it within `_PATIENCE`."""
    address = os.environ.get(VARIABLE)
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.settimeout(_PATIENCE)
        sender.sendto(state.encode(), address)


def watchdog_interval() -> float | None:
    """How often, in seconds, systemd wants to hear `WATCHDOG=1`, None where it does not."""
    wanted = os.environ.get("WATCHDOG_USEC", "")
    return int(wanted) / 1e6 / 2 if wanted.isdecimal() and int(wanted) else None
