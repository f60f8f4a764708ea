"""Arrays of goals' statuses as they are serialized: of those that come one after the other only what is new is decoded.

Servers list each goal for some seconds after its end, and send the list at every change: an array of 200 takes genpy a
quarter of a millisecond to read, and most of it is as before.
"""

from __future__ import annotations

import io
import struct
from typing import Dict, List, Sequence

import rospy
from actionlib_msgs.msg import GoalStatus
from std_msgs.msg import Header

from oracle_ros1.headers import header_of

_NUMBER = struct.Struct("<I")
_SEQ_AND_STAMP, _STAMP, _STATUS = 12, 8, 1
"""How long what stands before a header's frame, before a goal's id and between this and the text is (bytes)."""


class Entry:
    """A goal's status, which never changes."""

    __slots__ = ("code", "goal_id", "serialized")

    def __init__(self, found: GoalStatus, serialized: bytes) -> None:
        self.goal_id, self.code, self.serialized = found.goal_id, found.status, serialized


def entry_of(status: GoalStatus) -> Entry:
    """The entry of a status that is made here."""
    written = io.BytesIO()
    status.serialize(written)
    return Entry(status, written.getvalue())


class StatusArray:
    """A `GoalStatusArray` that came."""

    def __init__(self, message: rospy.AnyMsg, before: bytes, entries: Sequence[Entry]) -> None:
        """`before` is all of the message before the number of its entries."""
        self.message, self.entries, self._before = message, entries, before
        self.header = Header().deserialize(before)

    @property
    def source(self) -> str:
        """The node whose it is."""
        return str(header_of(self.message).get("callerid"))

    def having(self, entries: Sequence[Entry]) -> rospy.AnyMsg:
        """The message with other entries; itself where they are its own."""
        if entries == self.entries:
            return self.message
        made = rospy.AnyMsg()
        made._connection_header = self.message._connection_header  # noqa: SLF001 - rospy's own interface
        made._buff = b"".join([self._before, _NUMBER.pack(len(entries)), *(e.serialized for e in entries)])  # noqa: SLF001
        return made


class ArrayReader:
    """Reads arrays, and remembers the entries of the last one."""

    def __init__(self) -> None:
        self._known: Dict[bytes, Entry] = {}

    def read(self, message: rospy.AnyMsg) -> StatusArray:
        """Read a message. Raises whatever genpy and struct do, and ValueError."""
        serialized: bytes = message._buff  # noqa: SLF001 - rospy's own interface
        first = _SEQ_AND_STAMP + _NUMBER.size + _number(serialized, _SEQ_AND_STAMP)
        known, entries = self._known, []
        for part in _parts(serialized, first):
            entry = known.get(part)
            entries.append(Entry(GoalStatus().deserialize(part), part) if entry is None else entry)
        self._known = {entry.serialized: entry for entry in entries}
        return StatusArray(message, serialized[:first], entries)


def _parts(serialized: bytes, first: int) -> List[bytes]:
    """The serialized entries; their number stands at `first`."""
    found, at = [], first + _NUMBER.size
    for _ in range(_number(serialized, first)):
        text = at + _STAMP + _NUMBER.size + _number(serialized, at + _STAMP) + _STATUS
        end = text + _NUMBER.size + _number(serialized, text)
        found.append(serialized[at:end])
        at = end
    if at > len(serialized):
        raise ValueError(f"an array of statuses ends after {len(serialized)} bytes of {at}")
    return found


def _number(serialized: bytes, at: int) -> int:
    return int(_NUMBER.unpack_from(serialized, at)[0])
