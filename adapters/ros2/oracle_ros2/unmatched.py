"""Publishers and subscriptions that are on the graph and that DDS has not connected, though types and qualities fit.

As where an XML profile puts them into a partition, which is not on the graph: what they say is judged by nobody.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Callable

if TYPE_CHECKING:
    from collections.abc import Sequence

PATIENCE = 5.0
"""Seconds in which those that have just come are connected."""
WHY = "DDS has not connected it, as where an XML profile puts it into a partition"


class Unmatched:
    """Those of one topic."""

    def __init__(self, text: str, clock: Callable[[], float] = time.monotonic) -> None:
        """`text`: what is said of a node, as `publishes /scan, and nothing of it is heard`; `clock` returns seconds."""
        self._text, self._clock = text, clock
        self._since: float | None = None

    def look(self, nodes: Sequence[str], connected: int | None) -> str:
        """Who is not connected, empty for nobody or too early.

        `nodes`: those of all that fit, of which so many are `connected`; None where that is not told.
        """
        missing = 0 if connected is None else len(nodes) - connected
        if missing <= 0:
            self._since = None
            return ""
        if self._since is None:
            self._since = self._clock()
        if self._clock() - self._since < PATIENCE:
            return ""
        names = ", ".join(sorted(nodes))
        return f"{names if missing == len(nodes) else f'{missing} of {names}'} {self._text}: {WHY}"


def publishers_of(subscription: Any) -> int | None:
    """How many publishers a subscription is connected to; None where rclpy does not tell, as an old one."""
    return int(subscription.get_publisher_count()) if hasattr(subscription, "get_publisher_count") else None
