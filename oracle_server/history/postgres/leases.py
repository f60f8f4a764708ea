"""Leases that PostgreSQL's clock does not end: it was set back, and what was written before lies far ahead of it."""

from __future__ import annotations

import time

from oracle_server.process.settings import LONGEST_LEASE


class Unrenewed:
    """For how long nodes have not renewed their leases, by this process's own clock."""

    def __init__(self) -> None:
        self._seen: dict[str, tuple[object, float]] = {}

    def ended(self, node: str, lease: object) -> bool:
        """Whether a node's lease, which stands so now, was seen to stand so for longer than any lease lasts."""
        now = time.monotonic()
        was, since = self._seen.get(node, (None, now))
        if was != lease:
            since = now
        self._seen[node] = lease, since
        return now - since > LONGEST_LEASE
