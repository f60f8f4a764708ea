"""The messages of all files of a bag together, by the time of recording: files overlap, and times go back in one."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import TypeVar

from oracle_server.core.spec import SECOND
from oracle_server.replay.files.storage import Storage

_SLACK = SECOND
"""By how much (ns) a file may have messages of a topic out of order: recorders write from several threads."""
_BACK = (
    "its times go back, as where a simulation begins anew or a clock is set: what was recorded before and after that "
    "is judged as one, by time; cut it there"
)
_Source = TypeVar("_Source")
_Head = tuple[int, int, _Source, bytes, int]
"""The next message of a file: its time, the number of the file, what its channel has, the message, and when it was
published."""


def together(
    storages: Sequence[Storage], wanted: Sequence[Mapping[int, _Source]], note_gap: Callable[[], None]
) -> Iterator[tuple[_Source, int, bytes, int]]:
    """The messages of the channels that are `wanted` of each file, each with its time (ns) and what its channel has.

    Last is when it was published (ns), 0 where that is not known. Of equal times those of the file that is named first
    come first. A file is read once its first message may be the next one: of files that follow each other one at a
    time. `note_gap` is called where messages may be missing before the next one.
    """
    begins = _begins(storages)
    coming = deque(sorted(range(len(storages)), key=begins.__getitem__))
    heads: list[_Head[_Source]] = []
    files = [_of_file(storage, own, note_gap) for storage, own in zip(storages, wanted, strict=True)]
    while coming or heads:
        while coming and (not heads or begins[coming[0]] <= heads[0][0]):
            at = coming.popleft()
            _push(heads, at, next(files[at], None))
        if heads:
            time, at, source, raw, published = heapq.heappop(heads)
            yield source, time, raw, published
            _push(heads, at, next(files[at], None))


def _push(heads: list[_Head[_Source]], at: int, message: tuple[_Source, int, bytes, int] | None) -> None:
    if message is not None:
        source, time, raw, published = message
        heapq.heappush(heads, (time, at, source, raw, published))


def _begins(storages: Sequence[Storage]) -> list[float]:
    """When the first message of each file was recorded (ns); one that does not tell comes before the file behind it."""
    found, begins = list[float](), inf
    for storage in reversed(storages):
        begins = storage.oldest or begins
        found.append(begins)
    return found[::-1]


def _of_file(
    storage: Storage, wanted: Mapping[int, _Source], note_gap: Callable[[], None]
) -> Iterator[tuple[_Source, int, bytes, int]]:
    known = damages = len(storage.damages)
    course, topics = _Course(), {channel.id: channel.topic for channel in storage.channels}
    for number, time, raw, published, place in storage.messages(wanted) if wanted else ():
        if course.turns_back(topics[number], time, place):
            storage.damages.append(f"{topics[number]}: {_BACK}")
        if len(storage.damages) > damages:
            damages = len(storage.damages)
            note_gap()
        yield wanted[number], time, raw, published
    if known or len(storage.damages) > damages:  # what was known before it was read is mostly of its end
        note_gap()


class _Course:
    """Whether the times of a file's messages go back as these stand in it; they come by time, and not as they stand."""

    def __init__(self) -> None:
        """Begin with no message seen."""
        self._known: dict[str, _Seen] = {}
        self._told = False

    def turns_back(self, topic: str, time: int, place: int) -> bool:
        """Whether a message stands before one of its topic that is older by more than the slack; true once."""
        if self._told:
            return False
        seen = self._known.get(topic)
        if seen is None:
            seen = self._known[topic] = _Seen(time, place)
        elif time - seen.since > _SLACK:
            seen.older, seen.before = max(seen.older, seen.before), seen.last
            seen.since, seen.last = time, place
        elif place > seen.last:
            seen.last = place
        self._told = place < seen.older
        return self._told


@dataclass(slots=True)
class _Seen:
    """The messages of a topic: the last places of those since a time (ns), of some before, and of all older ones."""

    since: int
    last: int
    before: int = -1
    older: int = -1
