"""Leases by this process's own clock: PostgreSQL's may be set back or forward, and end none of them, or all."""

from __future__ import annotations

import time

from oracle_server.process.settings import LONGEST_LEASE


class Unrenewed:
    """For how long nodes have not renewed their leases, by this process's own clock."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[object, float]] = {}

    def seconds(self, node: str, lease: object) -> float:
        """For how long a node's lease, which stands so now, was seen to stand so."""
        now = time.monotonic()
        was, since = self._seen.get(node, (None, now))
        if was != lease:
            since = now
        self._seen[node] = lease, since
        return now - since

    def ended(self, node: str, lease: object) -> bool:
        """Whether it was seen to stand so for longer than any lease lasts."""
        return self.seconds(node, lease) > LONGEST_LEASE
