"""How often each property was violated, for so many properties at most."""

from __future__ import annotations

from collections.abc import Iterable

import structlog

from oracle_server.core.events import Order
from oracle_server.sessions.telling import News

MOST = 1_000
"""Pairs of a spec and a property that are counted by themselves."""
OTHER = ("other", "other")
"""The pair that stands for all further ones."""

log = structlog.get_logger()


class Violated:
    """Counts violations since the server started, by spec and property. None is taken back."""

    def __init__(self) -> None:
        self.counts: dict[tuple[str, str], int] = {}

    def expect(self, spec: str, properties: Iterable[str]) -> None:
        """Begin to count a spec's properties, so that their first violation is seen to be one more than none."""
        for prop in properties:
            self.pair(spec, prop)

    def add(self, spec: str, told: Iterable[News], order: Order) -> None:
        """Count the violations among what is told of a spec's session, of one order."""
        for frame in told:
            if frame["type"] == "violation" and frame["order"] == order:
                self.counts[self.pair(spec, frame["property"])] += 1

    def pair(self, spec: str, prop: str) -> tuple[str, str]:
        """The pair under which a property is counted: its own, or `OTHER` where there are too many."""
        pair = (spec, prop)
        if pair in self.counts:
            return pair
        if len(self.counts) < MOST:
            self.counts[pair] = 0
            return pair
        if OTHER not in self.counts:
            log.warning("more properties than are counted by themselves: further ones are `other`", most=MOST)
            self.counts[OTHER] = 0
        return OTHER
