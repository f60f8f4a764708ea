"""The messages of all files of a bag together, by the time of recording: files may overlap."""

from __future__ import annotations

import heapq
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf
from typing import TypeVar

from oracle_server.replay.storage import Storage

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
    for number, time, raw, published in storage.messages(wanted) if wanted else ():
        if len(storage.damages) > damages:
            damages = len(storage.damages)
            note_gap()
        yield wanted[number], time, raw, published
    if known or len(storage.damages) > damages:  # what was known before it was read is mostly of its end
        note_gap()
