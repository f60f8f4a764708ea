"""Arrays of goals' statuses, read and changed as they are serialized: each goal is in them until its result expires.

An array of 200 goals takes 5 ms to deserialize, and comes at each transition; in CDR its entries have a fixed length.
"""

from __future__ import annotations

from typing import Callable, Iterable, Mapping

from action_msgs.msg import GoalStatusArray
from rclpy.serialization import deserialize_message, serialize_message

WORDS = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
"""The statuses of goals, by their numbers."""
UNKNOWN, ABORTED = 0, 6
BEFORE = {4: 2, 5: 3, 6: 2}
"""The statuses that a goal keeps, and those in which it was before."""
FINAL = frozenset(BEFORE)

_LITTLE_ENDIAN = b"\x00\x01"
_COUNT = slice(4, 8)
_FIRST, _STATUS, _LENGTH, _ID = 8, 32, 28, 16
"""Where the first id and the first status are, and from one status to the next; how long an id is (bytes)."""

Statuses = Mapping[bytes, int]
"""Statuses by the goals' ids, 16 bytes each."""


def word(status: int) -> str:
    """The name of a status."""
    return WORDS[status] if 0 <= status < len(WORDS) else WORDS[UNKNOWN]


def read(array: bytes) -> dict[bytes, int]:
    """The statuses in a serialized array. Raises what rclpy does where it can't be read."""
    count = _count(array)
    if not count:
        return {bytes(one.goal_info.goal_id.uuid): one.status for one in _decoded(array).status_list}
    numbers = array[_STATUS : _STATUS + _LENGTH * count : _LENGTH]
    # an id follows the status before it; the first one follows the count
    starts = (_FIRST, *range(_STATUS + 1, _STATUS + _LENGTH * (count - 1), _LENGTH))
    return {array[start : start + _ID]: number for start, number in zip(starts, numbers, strict=True)}


def changed(array: bytes, change: Callable[[bytes, int], int | None]) -> bytes:
    """The array with what `change` makes of each id and status; None: without that goal."""
    statuses = {goal: change(goal, status) for goal, status in read(array).items()}
    if None not in statuses.values() and len(statuses) == _count(array):
        edited = bytearray(array)
        edited[_STATUS : _STATUS + _LENGTH * len(statuses) : _LENGTH] = bytes(statuses.values())  # type: ignore[arg-type]
        return bytes(edited)
    message = _decoded(array)
    kept = []
    for one in message.status_list:
        status = statuses[bytes(one.goal_info.goal_id.uuid)]
        if status is not None:
            one.status = status
            kept.append(one)
    message.status_list = kept
    return bytes(serialize_message(message))


class Transitions:
    """What each array says that the publisher's last one did not."""

    def __init__(self) -> None:
        self._last: dict[str, Statuses] = {}

    def begin(self, source: str, statuses: Statuses) -> None:
        """Take an array of a publisher as what was known before."""
        self._last[source] = statuses

    def of(self, source: str, statuses: Statuses) -> list[tuple[bytes, int]]:
        """The goals that are new, or stand otherwise, in the order of the array."""
        last = self._last.get(source, {})
        self._last[source] = statuses
        return [(goal, status) for goal, status in statuses.items() if last.get(goal) != status]

    @property
    def sources(self) -> list[str]:
        """The publishers of which there was an array."""
        return list(self._last)

    def knows(self, source: str) -> bool:
        """Whether there was an array of a publisher."""
        return source in self._last

    def keep(self, sources: Iterable[str]) -> None:
        """Forget all but these publishers."""
        self._last = {source: self._last[source] for source in sources if source in self._last}


def _count(array: bytes) -> int:
    """How many entries there are; 0, too, where they do not have their usual places."""
    count = int.from_bytes(array[_COUNT], "little")
    filling = len(array) - (_STATUS + 1 + _LENGTH * (count - 1))  # up to a multiple of four, at most
    return count if array[:2] == _LITTLE_ENDIAN and 0 <= filling < 4 else 0


def _decoded(array: bytes) -> GoalStatusArray:
    return deserialize_message(array, GoalStatusArray)
