"""Blocks of recorded messages: decompressed within bounds, and put in the order of recording."""

from __future__ import annotations

import bz2
import heapq
from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import lz4.frame
import zstandard

from oracle_server.replay.files.storage import LATEST, DamagedError, Message

LARGEST = 2**30
"""The most bytes of a block that is decompressed; recorders write blocks of some megabytes."""
_PIECE = 2**20
ZSTD = b"\x28\xb5\x2f\xfd"
"""How what zstd has compressed begins."""


class Block(NamedTuple):
    """A part of a file, by its place, with the times of its first and last messages (ns) as its headings tell them.

    Where they do not tell the last one, `end` is the last time that there is. `length` bytes of it are there. `size`
    bytes were compressed by the method `how`, where that stands outside the block; `chunk` is false for records that
    stand in no chunk.
    """

    start: int
    offset: int
    length: int
    chunk: bool = True
    how: str = ""
    size: int = 0
    end: int = LATEST

    def place(self, at: int) -> int:
        """The place of a message in the file, by that in the block's content."""
        return (self.offset << 32) + at


class InBlocks(ABC):
    """The messages of a file that has them in blocks, and between which times they were recorded."""

    damages: list[str]

    def __init__(self) -> None:
        self._blocks: list[Block] = []
        self._oldest = 0
        """The time of the oldest message that was read; 0 where none was."""
        self._newest: int | None = None
        """The time of the newest message that was read; None where none was."""
        self._untold = True
        """Whether the parts were not read yet whose headings do not tell when they begin."""
        self._nameless: set[int] = set()
        """The channels that were said to have no topic."""
        self._early: set[int] = set()
        """The places of blocks that were said to have messages older than their headings say."""

    def messages(self, wanted: Collection[int]) -> Iterator[Message]:
        """The messages of these channels, by the time of recording."""
        return in_order(self._blocks, lambda block: list(self._in_block(block, wanted)))

    @property
    def oldest(self) -> int:
        """The time of the first message, by the headings of the file's parts and what was read of them.

        Parts whose headings have 0, which is no time, are read.
        """
        untold, self._untold = self._untold, False
        newest = self._newest
        for block in self._blocks if untold and not self._oldest else ():
            if not block.start:
                for _ in self._in_block(block, ()):
                    pass
        self._newest = newest  # it is that of all parts, once it is known
        times = (self._oldest, *(block.start for block in self._blocks))
        return min((time for time in times if time), default=0)

    @property
    def newest(self) -> int:
        """The time of the last message that can be read; what may have it is read, unless the file's messages were."""
        blocks = sorted(self._blocks, key=_end, reverse=True) if self._newest is None else []
        for block in blocks:
            if block.end <= (self._newest or 0):
                break
            for _ in self._in_block(block, ()):
                pass
        return self._newest or 0

    def has_between(self, since: int, until: int) -> bool:
        """Whether a message was recorded between two times (ns); what the headings of a part leave open is read."""
        told, newest = len(self.damages), self._newest
        around = [block for block in self._blocks if block.start < until and block.end > since]
        inside = any(since < time < until for block in around for time in (block.start, block.end))
        found = inside or any(since < m[1] < until for block in around for m in self._in_block(block, None))
        del self.damages[told:]  # they were found with the messages
        self._newest = newest
        return found

    def _unnamed(self, block: Block, channel: int) -> None:
        """Note a message of which the file does not tell the topic, as where the part is damaged that does."""
        if channel not in self._nameless:
            self._nameless.add(channel)
            self._damaged(block, f"has messages of channel {channel}, of which the file does not tell the topic")

    def _heard(self, block: Block, time: int) -> None:
        """Note the time of a message that was read, whatever its channel; by that of its block it is out of order."""
        if 0 < time < block.start and block.offset not in self._early:
            self._early.add(block.offset)
            self._damaged(block, "has messages older than its heading says, which come behind others")
        if time:
            self._oldest = min(self._oldest or time, time)
        self._newest = max(self._newest or 0, time)

    @abstractmethod
    def _in_block(self, block: Block, wanted: Collection[int] | None) -> Iterator[Message]:
        """The messages of these channels in a block, None for all; each that is there is noted."""

    @abstractmethod
    def _damaged(self, block: Block, what: str) -> None:
        """Note what is wrong with a block."""


def in_order(blocks: Sequence[Block], read: Callable[[Block], list[Message]]) -> Iterator[Message]:
    """The messages of blocks by time; of equal times, as they stand in the file."""
    ordered = sorted(blocks, key=lambda block: block.start)
    waiting: list[_Waiting] = []
    for number, block in enumerate(ordered, start=1):
        if found := sorted(read(block), key=_time):
            heapq.heappush(waiting, _Waiting(_time(found[0]), number, 0, found))
        yield from _taken(waiting, ordered[number].start if number < len(ordered) else None)


class _Waiting(NamedTuple):
    """The messages of a block that others may come before: the time of the first, the block's number, and its place."""

    time: int
    number: int
    at: int
    messages: list[Message]


def _taken(waiting: list[_Waiting], until: int | None) -> Iterable[Message]:
    """Take what is no later than a time from a heap of what waits, all of it where there is none; in order.

    What is later is not looked at: where each block has a message of time 0, none is done with before the last.
    """
    parts = []
    while waiting and (until is None or waiting[0].time <= until):
        _, number, at, messages = heapq.heappop(waiting)
        end = len(messages) if until is None else bisect_right(messages, until, at, key=_time)
        parts.append((number, messages[at:end]))
        if end < len(messages):
            heapq.heappush(waiting, _Waiting(_time(messages[end]), number, end, messages))
    if len(parts) == 1:
        return parts[0][1]
    return heapq.merge(*(part for _, part in sorted(parts)), key=_time)


def _end(block: Block) -> int:
    return block.end


def _time(message: Message) -> int:
    return message[1]


def decompress(data: bytes, how: str, size: int) -> tuple[bytes, bool]:
    """What `size` bytes were compressed to, as far as that can be read, and whether it is whole.

    Raises `DamagedError` where nothing can be read of it.
    """
    if how in ("", "none"):
        return data, len(data) == size
    if size > LARGEST:
        raise DamagedError(f"says that it unpacks to {size} bytes, and at most {LARGEST} are read")
    if how not in _DECOMPRESSORS:
        raise DamagedError(f"is compressed by '{how[:20]}', which is not known")
    found = _DECOMPRESSORS[how](data, size)
    return found, len(found) == size


def _zstd(data: bytes, size: int) -> bytes:
    pieces, total = [], 0
    try:
        with zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(data) as reader:
            while total < size and (piece := reader.read(min(_PIECE, size - total))):
                pieces.append(piece)
                total += len(piece)
    except (zstandard.ZstdError, MemoryError):
        pass
    return b"".join(pieces)


def _incremental(make: Callable[[], Any], errors: tuple[type[Exception], ...]) -> Callable[[bytes, int], bytes]:
    def read(data: bytes, size: int) -> bytes:
        pieces, total, decompressor = [], 0, make()
        try:
            while total < size and not decompressor.eof:
                piece = decompressor.decompress(data, min(_PIECE, size - total))
                data = b""
                if not piece and decompressor.needs_input:
                    break
                pieces.append(piece)
                total += len(piece)
        except errors:
            pass
        return b"".join(pieces)

    return read


_DECOMPRESSORS: dict[str, Callable[[bytes, int], bytes]] = {
    "zstd": _zstd,
    "lz4": _incremental(lz4.frame.LZ4FrameDecompressor, (RuntimeError, EOFError, ValueError)),
    "bz2": _incremental(bz2.BZ2Decompressor, (OSError, EOFError, ValueError)),
}
