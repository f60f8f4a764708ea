"""How the messages of a topic are numbered, each publisher's by itself, where the middleware tells that."""

from __future__ import annotations

from typing import Any, Callable, Mapping

HANDLE = 8
"""Bytes of the number that Cyclone DDS gives a publisher for this process alone; zeros follow, and none in DDS's."""
MOST = 1000
"""Publishers that are remembered: over days many come and go, and what they had lasts as long as the adapter."""


class Numbers:
    """The publishers of a topic that were heard last, and the last number of each."""

    def __init__(self, on_new: Callable[[], None] = lambda: None) -> None:
        """`on_new` is called before the first message of each publisher is counted."""
        self._on_new = on_new
        self._last: dict[str, tuple[int, int]] = {}  # with the latest time at which it published (ns)

    def missed(self, source: str, info: Mapping[str, Any]) -> int:
        """How many messages of a publisher were lost just before this one, by its number; -1 where it is old.

        0 where the middleware does not tell. A node that was started again has the publisher of before where its
        profile says by which numbers DDS knows it: what it published later is not old, though its number is lower.
        """
        number: int = info["publication_sequence_number"] if is_numbered(info) else 0
        published: int = info["source_timestamp"]
        before, latest = self._last.pop(source, (None, published))
        if before is None or (number < before and published > latest):
            self._on_new()
            before = number - 1
        self._last[source] = max(number, before), max(published, latest)  # and who was heard last comes last
        if len(self._last) > MOST:
            del self._last[next(iter(self._last))]
        return max(-1, number - before - 1) if number else 0


def is_numbered(info: Mapping[str, Any]) -> bool:
    """Whether a message's number is told, and whose it is: rclpy tells of publishers since Kilted.

    A number alone says nothing: each publisher begins at 1, also a node that was started again.
    """
    return bool(source_of(info)) and info.get("publication_sequence_number") is not None


def source_of(info: Mapping[str, Any]) -> str:
    """The publisher of a message, as the graph has it; empty where the middleware does not tell.

    So it is over Cyclone DDS: it tells of a number that is nobody's on the graph, as if that publisher had ended.
    """
    publisher = info.get("publisher_gid")
    return publisher["data"].hex() if publisher and any(publisher["data"][HANDLE:]) else ""
