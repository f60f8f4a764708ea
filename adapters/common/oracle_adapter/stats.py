"""What the link counts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass
class Stats:
    """Counters since the link was made, in events unless stated otherwise."""

    queued: int = 0
    """Waiting to be sent or acked, now."""
    sent: int = 0
    """Written to a connection, each counted once."""
    resent: int = 0
    """Written again after a reconnect."""
    acked: int = 0
    """Known to be in the server's committed history."""
    lost: int = 0
    """Not coming into the server's history: queue full, too large, link over, or history lost."""
    refused: int = 0
    """Refused by the server, each with an error."""
    timeouts: int = 0
    """Asks that ended without a decision though the link was attached."""
    unavailable: int = 0
    """Asks without a decision because the link was away or over, or the event lost or refused."""
    reconnects: int = 0
    """Connections attached after the first."""
