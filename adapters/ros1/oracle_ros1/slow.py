"""Subscribers that are slow, or hang: of large messages fewer wait for them than rospy would keep."""

from __future__ import annotations

import rospy
from rospy.impl.tcpros_pubsub import QueuedConnection

DEPTH = 1000
"""Messages that wait for a subscriber, at the most."""
FEW = 10
"""As many may wait whatever they take."""
ROOM = 2**28
"""Bytes that may wait beyond that."""


def keep_room(publisher: rospy.Publisher, size: int) -> None:
    """Have no more wait for the subscribers of a publisher than there is room for, as one of a size (bytes) was given.

    The oldest go, as they do where there are too many.
    """
    if size * DEPTH <= ROOM or publisher.impl is None:
        return
    for connection in list(publisher.impl.connections or ()):
        if isinstance(connection, QueuedConnection):
            _shorten(connection)


def _shorten(connection: QueuedConnection) -> None:
    with connection._lock:  # noqa: SLF001 - rospy has no other place for it
        waiting = connection._queue  # noqa: SLF001
        over = sum(map(len, waiting)) - ROOM
        while over > 0 and len(waiting) > FEW:
            over -= len(waiting.pop(0))
