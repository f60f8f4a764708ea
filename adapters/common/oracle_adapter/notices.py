"""What a link tells of what the server said."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Mapping, Optional, Tuple, Union

from oracle_adapter.errors import LinkError

if TYPE_CHECKING:
    from oracle_adapter.decision import Answer
    from oracle_adapter.queued import Queued


@dataclass(frozen=True)
class Attached:
    """What the server answered: the session, and the streams to observe, as it described them."""

    monitor: str
    session: str
    spec: Optional[str]
    spec_digest: Optional[str]
    streams: Tuple[Mapping[str, Any], ...]
    limits: Mapping[str, Any]

    def has(self, stream: str, kind: str) -> bool:
        """Whether a stream is among those to observe."""
        return any(one["name"] == stream and one["kind"] == kind for one in self.streams)


@dataclass(frozen=True)
class Answered:
    """An ask has its answer."""

    event: Queued
    answer: Answer


@dataclass(frozen=True)
class Violation:
    """The server recorded a violation."""

    record: Mapping[str, Any]


@dataclass(frozen=True)
class Revision:
    """Verdicts stand otherwise than was said."""

    record: Mapping[str, Any]


@dataclass(frozen=True)
class Episode:
    """The server tells of an episode, instead of its violations."""

    frame: Mapping[str, Any]


@dataclass(frozen=True)
class Room:
    """There may be events to write again."""


@dataclass(frozen=True)
class Verdicts:
    """The server reported the state of the properties."""

    frame: Mapping[str, Any]


Notice = Union[Attached, Answered, Violation, Revision, Episode, Verdicts, Room, LinkError]
