"""ROS 1 bags, read record by record: bags that were not closed, and damaged ones, as far as they go."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from oracle_server.core.errors import TraceError, one_line
from oracle_server.replay.files.blocks import Block, InBlocks, decompress
from oracle_server.replay.files.storage import LATEST, Channel, DamagedError, Message, is_lasting

MAGIC = b"#ROSBAG V2.0\n"
_MESSAGE, _BAG, _INDEX, _CHUNK, _INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_LARGEST_HEAD = 2**26
_Fields = dict[bytes, bytes]


class Ros1File(InBlocks):
    """The channels and messages of a ROS 1 bag."""

    def __init__(self, path: Path) -> None:
        """Find the chunks and channels. Raises `TraceError` where it is no ROS 1 bag, and OSError."""
        super().__init__()
        self.path = path
        self.damages: list[str] = []
        self.described: list[str] = []
        self._channels: dict[int, Channel] = {}
        self._counts: Counter[int] = Counter()
        self._ended_early = False
        self._indexed = 0
        """Up to which of the chunks there was an index, counted from 1."""
        self._unindexed = False
        """Whether there was none behind a chunk that others follow."""
        self._file: BinaryIO = path.open("rb")
        try:
            self._scan(path.stat().st_size)
        except BaseException:
            self._file.close()
            raise

    @property
    def channels(self) -> list[Channel]:
        """The channels."""
        return [c._replace(promised=self._counts[c.id]) for c in self._channels.values()]

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _scan(self, size: int) -> None:
        """Go from record to record, without what is in chunks; where channels may be missing, look there."""
        if self._file.read(len(MAGIC)) != MAGIC:
            raise TraceError(f"{self.path}: is no ROS 1 bag")
        position, index, chunks, told, closed = len(MAGIC), 0, 0, 0, False
        while position < size:
            try:
                fields, body, length = self._record_at(position)
                kind = _number(fields, b"op", 1)
                told += kind == _INFO and body + length <= size
                if kind == _BAG:
                    self._refuse_encrypted(fields)
                    index = _number(fields, b"index_pos", 8)
                    chunks, closed = int.from_bytes(fields.get(b"chunk_count", b""), "little"), index > 0
                elif kind == _CHUNK:
                    self._chunk(fields, body, min(length, size - body))
                elif body + length <= size:
                    self._note(kind, fields, length)
            except (DamagedError, struct.error, UnicodeDecodeError):
                if position < index < size and len(self._blocks) == chunks:
                    position = index  # behind the last chunk a bag may have bytes that are none of its records
                    continue
                break
            if body + length > size:
                break
            position = body + length
        self._conclude(position, size, closed=closed, whole=closed and told == chunks == len(self._blocks))

    def _conclude(self, position: int, size: int, *, closed: bool, whole: bool) -> None:
        """Say how far the file could be read; `whole`: all chunks that it should have are there, and were closed."""
        self._ended_early = not whole and (position < size or not closed)
        if self._ended_early:
            where = "in the record at byte" if position < size else "at byte"
            self.damages.append(f"ends early, {where} {position} of {size}: the bag was not closed")
        elif position < size:
            self.damages.append(f"has {size - position} bytes behind its end that were not read, as of another bag")
        if self._ended_early or self._unindexed or self._indexed < len(self._blocks):
            self._count()

    def _refuse_encrypted(self, fields: _Fields) -> None:
        by = fields.get(b"encryptor", b"").decode(errors="replace")
        if by:
            what = f"is encrypted ({by}), which is not read: `rosbag decrypt` it first"
            raise TraceError(one_line(f"{self.path}: {what}"))

    def _count(self) -> None:
        """Count the messages by reading them; chunks without an index have their times from them, too."""
        known = len(self.damages)
        self._counts.clear()
        for at, block in enumerate(self._blocks):
            times = []
            for number, time, *_ in self._in_block(block, None):
                self._counts[number] += 1
                times.append(time)
            if times and block.end == LATEST:
                self._blocks[at] = block._replace(start=min(times), end=max(times))
        del self.damages[known:]  # they are found again with the messages
        self._nameless.clear()
        self._early.clear()

    def _record_at(self, position: int) -> tuple[_Fields, int, int]:
        """The heading of the record at a place, the place of its data, and their length. Raises `DamagedError`."""
        self._file.seek(position)
        (length,) = struct.unpack("<I", self._file.read(4))
        if length > _LARGEST_HEAD:
            raise DamagedError("a heading is too long")
        fields = _fields(self._file.read(length))
        (size,) = struct.unpack("<I", self._file.read(4))
        return fields, position + 8 + length, size

    def _chunk(self, fields: _Fields, offset: int, length: int) -> None:
        how, size = fields.get(b"compression", b"").decode(), _number(fields, b"size", 4)
        self._unindexed |= self._indexed < len(self._blocks)
        start = self._blocks[-1].start if self._blocks else 0
        self._blocks.append(Block(start, offset, length, how=how, size=size))

    def _note(self, kind: int, fields: _Fields, length: int) -> None:
        if kind == _INDEX:
            self._index(fields, self._file.read(length))
        elif kind == _CONNECTION:
            self._connection(fields, self._file.read(length))

    def _index(self, fields: _Fields, data: bytes) -> None:
        """Take the times of a chunk's messages on one connection from the index behind the chunk."""
        first, self._indexed = self._indexed < len(self._blocks), len(self._blocks)
        self._counts[_number(fields, b"conn", 4)] += _number(fields, b"count", 4)
        times = [_nanoseconds(*entry[:2]) for entry in struct.iter_unpack("<III", data[: len(data) // 12 * 12])]
        if times and self._blocks:
            block = self._blocks[-1]
            start, end = (min(times), max(times)) if first else (min(block.start, *times), max(block.end, *times))
            self._blocks[-1] = block._replace(start=start, end=end)

    def _connection(self, fields: _Fields, data: bytes) -> None:
        about = {key: value.decode(errors="replace") for key, value in _fields(data).items()}
        topic = fields.get(b"topic", b"").decode(errors="replace")
        package, _, name = about.get(b"type", "").rpartition("/")
        number = _number(fields, b"conn", 4)
        kind = f"{package}/msg/{name}"
        channel = Channel(number, topic, kind, about.get(b"message_definition", ""), "ros1msg", "ros1")
        channel = channel._replace(lasts=is_lasting(latching=about.get(b"latching", "")))
        self._channels.setdefault(number, channel)

    def _in_block(self, block: Block, wanted: Collection[int] | None) -> Iterator[Message]:
        self._file.seek(block.offset)
        try:
            data, whole = decompress(self._file.read(block.length), block.how, block.size)
        except DamagedError as error:
            self._damaged(block, str(error))
            return
        at, size = 0, len(data)
        try:
            while at < size:
                (head,) = struct.unpack_from("<I", data, at)
                (length,) = struct.unpack_from("<I", data, at + 4 + head)
                end = at + 8 + head + length
                if end > size:
                    whole = False
                    break
                fields = _fields(data[at + 4 : at + 4 + head])
                kind, number = _number(fields, b"op", 1), _number(fields, b"conn", 4)
                asked, stamp = wanted is None or number in wanted, fields.get(b"time", b"")
                if kind == _MESSAGE and (asked or len(stamp) == 8):  # what nobody asked for does no harm
                    time = _nanoseconds(*struct.unpack("<II", stamp))
                    self._heard(block, time)
                    if number not in self._channels:
                        self._unnamed(block, number)
                    if asked:
                        yield number, time, data[end - length : end], 0, block.place(at)
                elif kind == _CONNECTION:
                    self._connection(fields, data[end - length : end])
                at = end
        except (DamagedError, struct.error):
            whole = False
        if not whole:
            self._damaged(block, "is not whole")

    def _damaged(self, block: Block, what: str) -> None:
        if not self._ended_early or block is not self._blocks[-1]:
            self.damages.append(f"the part at byte {block.offset} {what}")


def _fields(data: bytes) -> _Fields:
    """The fields of a heading. Raises `DamagedError`."""
    found, at = {}, 0
    while at < len(data):
        (length,) = struct.unpack_from("<I", data, at)
        name, sign, value = data[at + 4 : at + 4 + length].partition(b"=")
        if not sign or at + 4 + length > len(data):
            raise DamagedError("a heading can't be read")
        found[name] = value
        at += 4 + length
    return found


def _number(fields: _Fields, name: bytes, size: int) -> int:
    """A field's number. Raises `DamagedError` where there is none of this size."""
    value = fields.get(name, b"")
    if len(value) != size:
        raise DamagedError("a field is missing")
    return int.from_bytes(value, "little")


def _nanoseconds(seconds: int, rest: int) -> int:
    return seconds * 10**9 + rest
