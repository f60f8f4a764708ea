"""One event on its way to the server."""

from __future__ import annotations

from typing import Optional

HEAD = 128
"""More bytes than an event has before its body."""


class Queued:
    """One event on its way; `number` counts what was queued, `seq` is its number on the wire."""

    __slots__ = ("body", "lost", "number", "seq", "stamp", "waiting")

    def __init__(
        self, number: int, stamp: Optional[int], body: str, *, lost: int, waiting: bool
    ) -> None:
        self.number, self.stamp, self.body = number, stamp, body
        self.lost, self.waiting = lost, waiting
        self.seq: Optional[int] = None

    @property
    def size(self) -> int:
        """Bytes in a frame, at most."""
        return HEAD + len(self.body)

    def text(self) -> str:
        """The event as a frame of its own, or as one of a batch."""
        stamp = "" if self.stamp is None else f'"stamp":{self.stamp},'
        lost = f'"lost":{self.lost},' if self.lost else ""
        return f'{{"type":"event","seq":{self.seq},{stamp}{lost}{self.body}'
