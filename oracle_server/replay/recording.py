"""A recording, whatever its format: events, and what was recorded about them live."""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Iterator, Mapping
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from msgspec import Struct

from oracle_server.core.engine import Answer
from oracle_server.core.events import Event, Released
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.units import counted


class Projected(NamedTuple):
    """Used instead of a message: its signals, and which of them failed."""

    signals: Mapping[str, Scalar]
    failed: frozenset[str]


class Place(Struct, frozen=True, gc=False):
    """Where a session judged an event in one of its orders, and when (ns).

    `position` counts all steps, of both orders; `degraded` is whether something before was known to be lost; `bypassed`
    are the properties that were degraded only because a stream of theirs was bypassed at the time; `said` are the
    answers of external oracles, by the properties that they judge; `place` is that of a late event which was put in its
    place among the steps, and `released` why the order let the event go.
    """

    position: int
    order: Literal["publication", "arrival"]
    judged: int
    late: bool = False
    skewed: bool = False
    forced: bool = False
    skipped: bool = False
    degraded: bool = False
    bypassed: tuple[str, ...] = ()
    said: dict[str, Answer] = {}
    place: int | None = None
    released: Released | None = None


class Recorded(Struct, frozen=True, gc=False):
    """A recorded event; a session's own trace also has ticks, places, and what the adapter did with the event and why.

    `verdict` is that of ROSMonitoring's oracle; `begun` is when the recorded session began (ns). `place` is where it
    stands in a log of JSON, empty in other recordings, whose messages are whole.
    """

    event: Event
    places: tuple[Place, ...] = ()
    passed: bool | None = None
    why: str | None = None
    verdict: str | None = None
    begun: int | None = None
    place: str = ""


class Note(NamedTuple):
    """Something that is to be known of a recording, as one line.

    `doubt`: not all that the spec is about could be judged; `unusable`: none of some stream could be read. `unread` is
    the name of a topic, service or action some of whose messages could not be read: what reads it was not judged there.
    """

    text: str
    doubt: bool = False
    unusable: bool = False
    unread: str = ""


def part_of(some: int, messages: int) -> str:
    """Some of a topic's messages, as the subject of a sentence with its verb."""
    if some < messages:
        return f"{some} of its {messages} messages {'is' if some == 1 else 'are'}"
    return "its only message is" if messages == 1 else f"its {messages} messages are"


def passed_beside(name: str, messages: int) -> Note:
    """Says that messages passed beside a filter."""
    was = "was" if messages == 1 else "were"
    what = counted(messages, "message")
    return Note(f"{name}: {what} passed that nobody asked for, and {was} not judged", doubt=True)


class Recording(Protocol):
    """A recording for one spec, in the order of arrival; `read` of `size` units are read.

    `clocked` is whether it has times of arrival; `ignored` counts events of streams that the spec does not observe;
    `notes` grow while it is read. It went on from `since`, known with the first event, until `until`, known once it is
    read: when (ns) the first and the last of all that it has arrived, of whatever stream, 0 where that is not known.
    `lost` is how often events may be missing behind the last one of the spec's streams.
    """

    path: Path
    clocked: bool
    ignored: Counter[str]
    notes: list[Note]
    read: int
    size: int
    since: int
    until: int
    lost: int

    @property
    def passed_over(self) -> Container[int]:
        """The positions, as far as it is read, of events that a session has judged and the spec does not observe."""
        ...

    def __iter__(self) -> Iterator[Recorded]:
        """The events of the spec's streams. Raises `TraceError`."""
        ...
