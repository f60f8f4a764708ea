"""What the files of a bag have in common: channels, and messages that are read as far as the file is whole."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import NamedTuple, Protocol

from oracle_server.core.errors import OracleError


class Channel(NamedTuple):
    """The messages of one type on one topic.

    `definition` is the text of the type in an `encoding` (`ros1msg`, `ros2msg` or `ros2idl`), empty where the file has
    none; `serialization` is `ros1`, `cdr`, or what this program does not read; `promised` is how many messages
    the file says that it has, None where it does not say; `lasts`: its publishers keep messages for who comes later.
    """

    id: int
    topic: str
    type: str
    definition: str = ""
    encoding: str = ""
    serialization: str = "cdr"
    promised: int | None = None
    lasts: bool = False


_LASTING = re.compile(r"durability: *(1\b|transient_local)")
_LATCHED = frozenset({"1", "true"})
"""As ROS 1 writes it, and as MCAP's profile for ROS 1 has it."""
LATEST = 2**63 - 1
"""The last time that there is (ns since the epoch)."""
LARGEST = 2**20
"""The most characters of metadata that are read."""
Message = tuple[int, int, bytes, int, int]
"""The id of a channel, the time of recording (ns since the epoch), the message as it was sent, and when that was.

That is 0 where the file does not tell it. The last is its place in the file: greater for what stands behind."""


class Storage(Protocol):
    """One file of messages.

    `damages` says what of the file could not be read, and grows while it is. `described` is the metadata of its bag
    that the file itself has, as of when the file was written: rosbag2 writes it there since Iron.
    """

    damages: list[str]
    described: list[str]

    @property
    def channels(self) -> list[Channel]:
        """The channels of the file."""
        ...

    def messages(self, wanted: Collection[int]) -> Iterator[Message]:
        """The messages of these channels, by the time of recording. Damage ends them early, and raises nothing."""
        ...

    @property
    def oldest(self) -> int:
        """The time of recording of the first message, on any channel; 0 where that is not known."""
        ...

    @property
    def newest(self) -> int:
        """The time of recording of the last message that can be read, on any channel; 0 where there is none."""
        ...

    def has_between(self, since: int, until: int) -> bool:
        """Whether a message that can be read was recorded between two times (ns), on any channel."""
        ...

    def close(self) -> None:
        """Close the file."""
        ...


class Missing:
    """A file of a bag that is not there or can't be opened, for the reason `why`: nothing of it can be read."""

    def __init__(self, why: str) -> None:
        self.damages = [why]
        self.described: list[str] = []
        self.channels: list[Channel] = []
        self.oldest = self.newest = 0

    def messages(self, wanted: Collection[int]) -> Iterator[Message]:
        """No messages."""
        del wanted
        return iter(())

    def has_between(self, since: int, until: int) -> bool:
        """Nothing was read."""
        del since, until
        return False

    def close(self) -> None:
        """Nothing is open."""


def is_lasting(qos: str = "", latching: str = "") -> bool:
    """Whether publishers keep messages for who comes later, by what bags say of that.

    `qos` is what publishers of ROS 2 offer, and `latching` stands in the connection of one of ROS 1.
    """
    return _LASTING.search(qos) is not None or latching in _LATCHED


class DamagedError(OracleError):
    """A part of a file that can't be read; what can be is judged."""
