"""What a definition in a recording may ask for: arrays that no message holds are refused before they are read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rosbags.interfaces import Nodetype

from oracle_server.core.errors import TraceError, one_line
from oracle_server.rostypes.bagtypes import NOTHING

_MOST = 2**16
"""The most elements of fixed arrays of messages in all types together: each has code of its own that reads it."""
_TEXT = 4
"""As how many of them a text counts, by what is made for it."""


def refuse_vast(name: str, types: Mapping[str, Any], *, ros1: bool) -> None:
    """Raise `TraceError` where a type, or one in it, has fixed arrays that no message holds.

    A message without fields takes a byte in ROS 2, so that what a message holds is bound by its bytes; in ROS 1 it
    takes none, and as many of them are refused.
    """
    total = 0
    for whole, (_, fields) in types.items():
        for field, (node, of) in fields:
            if node == Nodetype.ARRAY and _is_made_for_each(of[0]):
                total += of[1] * (1 if of[0][0] == Nodetype.NAME else _TEXT)
                if total > _MOST:
                    what = f"{name}: the field `{field}` of {whole} has {of[1]} elements, which no message of ROS has"
                    raise TraceError(one_line(what))
    if ros1 and _Bare(types).count(name) > _MOST:
        raise TraceError(one_line(f"{name}: has more than {_MOST} parts without a byte, which no message of ROS has"))


def _is_made_for_each(element: Any) -> bool:
    return element[0] == Nodetype.NAME or (element[0] == Nodetype.BASE and element[1][0] in ("string", "wstring"))


class _Bare:
    """Counts the messages without a byte of which a message of ROS 1 consists by its type alone."""

    def __init__(self, types: Mapping[str, Any]) -> None:
        self._types = types
        self._known: dict[str, tuple[bool, int]] = {}

    def count(self, name: str) -> int:
        return self._look(name)[1]

    def _look(self, name: str) -> tuple[bool, int]:
        """Whether a message of a type has bytes, and how many without one it consists of."""
        if name not in self._known:
            self._known[name] = True, 0  # a type within itself is refused elsewhere
            parts = list(self._parts(name))
            filled = any(has for has, _ in parts)
            self._known[name] = filled, sum(count for _, count in parts) + (not filled)
        return self._known[name]

    def _parts(self, name: str) -> Iterator[tuple[bool, int]]:
        for field, (node, of) in self._types[name][1]:
            element, length = of if node == Nodetype.ARRAY else ((node, of), 1)
            if field == NOTHING[0] or not length:
                continue
            filled, count = self._look(element[1]) if element[0] == Nodetype.NAME else (True, 0)
            yield filled, length * count
