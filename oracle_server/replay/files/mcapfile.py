"""MCAP files, read record by record: an index that is damaged or missing does no harm."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from oracle_server.core.errors import TraceError
from oracle_server.replay.files.blocks import Block, InBlocks, decompress
from oracle_server.replay.files.storage import LATEST, Channel, DamagedError, Message, is_lasting

MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _STATISTICS, _METADATA = 1, 2, 3, 4, 5, 6, 11, 12
_NOTHING = 0
"""The kind of no record: what a disk had room for and not written yet, when the power went, is all zeros."""
_RECORD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_STATISTICS_HEAD = struct.Struct("<QHIIIIQQ")
_RUN = 2**20
"""The most bytes of records outside chunks that are read at once."""
_NO_TIME = 2**64 - 1
"""Of a record that has none: it is later than any."""
_LARGEST_NOTE = 2**26
"""The most bytes of a schema, a channel or the statistics."""


class McapFile(InBlocks):
    """The channels and messages of an MCAP file."""

    def __init__(self, path: Path) -> None:
        """Find the chunks, channels and schemas. Raises `TraceError` where it is no MCAP file, and OSError."""
        super().__init__()
        self.path = path
        self.profile = ""
        self.damages: list[str] = []
        self.described: list[str] = []
        self._ended_early = False
        self._schemas: dict[int, tuple[str, str, str]] = {}
        self._channels: dict[int, Channel] = {}
        self._schema_of: dict[int, int] = {}
        self._counts: dict[int, int] | None = None
        self._file: BinaryIO = path.open("rb")
        try:
            self._scan(path.stat().st_size)
        except BaseException:
            self._file.close()
            raise

    @property
    def channels(self) -> list[Channel]:
        """The channels, each with what is known of its schema; a summary may have the channel without it."""
        counts = self._counts
        found = []
        for channel in self._channels.values():
            name, encoding, text = self._schemas.get(self._schema_of[channel.id], ("", "", ""))
            promised = None if counts is None else counts.get(channel.id, 0)
            found.append(channel._replace(type=name, definition=text, encoding=encoding, promised=promised))
        return found

    def in_file_order(self) -> Iterator[Message]:
        """All messages, as they stand in the file."""
        for block in self._blocks:
            yield from self._in_block(block, None)

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _scan(self, size: int) -> None:
        """Go from record to record, without what is in chunks; where that does not tell all channels, look there."""
        if self._file.read(len(MAGIC)) != MAGIC:
            raise TraceError(f"{self.path}: is no MCAP file")
        position, ended, run, channels = len(MAGIC), False, False, None
        while not ended and (record := self._record_at(position, size)) is not None:
            kind, length, there = record
            body = position + _RECORD.size
            run = kind == _MESSAGE or (run and kind in (_SCHEMA, _CHANNEL))
            if run:
                time = self._heading(_MESSAGE_HEAD, there)[2] if kind == _MESSAGE else 0
                self._add_to_run(position, _RECORD.size + there, time)
            elif kind == _CHUNK:
                start, end = self._heading(_CHUNK_HEAD, there)[:2]
                self._blocks.append(Block(start, body, there, end=end or LATEST))
            if there < length or kind == _NOTHING:
                break
            if kind in (_HEADER, _SCHEMA, _CHANNEL, _STATISTICS, _METADATA) and length <= _LARGEST_NOTE:
                self._file.seek(body)
                channels = self._note(kind, self._file.read(length)) or channels
            ended = kind == _FOOTER
            position = body + length
        self._ended_early = not ended
        if self._ended_early:
            self.damages.append(f"ends early, in the record at byte {position} of {size}")
        missing = channels is None or channels > len(self._channels) or self._lacks_schemas
        if not ended or missing or self._counts is None:
            told = len(self.damages)
            read = Counter(number for block in self._blocks for number, *_ in self._in_block(block, None))
            self._counts = read if self._counts is None else self._counts
            del self.damages[told:]  # they are found again with the messages
            self._nameless.clear()
        behind = size - position - len(MAGIC)
        if ended and behind > 0:
            self.damages.append(f"has {behind} bytes behind its end that were not read, as of a file that was appended")

    @property
    def _lacks_schemas(self) -> bool:
        """Whether a schema of a channel is not known yet; the number 0 stands for none."""
        return any(schema and schema not in self._schemas for schema in self._schema_of.values())

    def _record_at(self, position: int, size: int) -> tuple[int, int, int] | None:
        """The kind of the record at a place, its length, and how much of that is there; None behind the last one."""
        self._file.seek(position)
        head = self._file.read(_RECORD.size)
        if len(head) < _RECORD.size:
            return None
        kind, length = _RECORD.unpack(head)
        return kind, length, min(length, size - position - _RECORD.size)

    def _add_to_run(self, position: int, length: int, time: int) -> None:
        """Take a record that stands in no chunk; one without a `time` has 0 there."""
        start, last = time or _NO_TIME, self._blocks[-1] if self._blocks else None
        if last is None or last.chunk or last.length > _RUN or last.offset + last.length != position:
            self._blocks.append(Block(start, position, length, chunk=False, end=time))
        else:
            start, end, length = min(last.start, start), max(last.end, time), last.length + length
            self._blocks[-1] = Block(start, last.offset, length, chunk=False, end=end)

    def _heading(self, head: struct.Struct, there: int) -> tuple[int, ...]:
        """The heading of the record which is read next; all zeros where it is not whole."""
        data = self._file.read(min(there, head.size))
        return head.unpack(data if len(data) == head.size else bytes(head.size))

    def _note(self, kind: int, data: bytes) -> int | None:
        """Keep what a record says; of statistics, returns the number of channels."""
        try:
            if kind == _HEADER:
                self.profile = _string(data, 0)[0]
            elif kind == _SCHEMA:
                name, at = _string(data, 2)
                encoding, at = _string(data, at)
                told = name, encoding, _bytes(data, at).decode(errors="replace")
                if self._schemas.setdefault(_short(data, 0), told) != told:
                    self.damages.append(f"tells two types of schema {_short(data, 0)}, one of them {name}")
            elif kind == _CHANNEL:
                self._note_channel(data)
            elif kind == _METADATA:
                name, at = _string(data, 0)
                self.described += [_map(data, at).get("serialized_metadata", "")] if name == "rosbag2" else []
            elif kind == _STATISTICS:
                at = _STATISTICS_HEAD.size + 4
                pairs = struct.iter_unpack("<HQ", data[at : at + struct.unpack_from("<I", data, at - 4)[0]])
                total, _, channels = _STATISTICS_HEAD.unpack_from(data)[:3]
                counts = dict(pairs)
                # an empty one says that the numbers are not known, and not that there are no messages
                self._counts = counts if sum(counts.values()) == total else None
                return int(channels)
        except (struct.error, UnicodeDecodeError):
            self.damages.append("has a record that can't be read")
        return None

    def _note_channel(self, data: bytes) -> None:
        number, schema = _short(data, 0), _short(data, 2)
        topic, at = _string(data, 4)
        serialization, at = _string(data, at)
        about = _map(data, at)
        lasts = is_lasting(about.get("offered_qos_profiles", ""), about.get("latching", ""))
        channel = Channel(number, topic, "", serialization=serialization, lasts=lasts)
        before = self._channels.setdefault(number, channel)
        if before is channel:
            self._schema_of[number] = schema
        elif before.topic != topic:  # as of files that were put together
            self.damages.append(f"tells two topics of channel {number}, {before.topic} and {topic}")
        elif (self._schema_of[number], before.serialization) != (schema, serialization):
            self.damages.append(f"tells two types of channel {number}, {topic}")

    def _in_block(self, block: Block, wanted: Collection[int] | None) -> Iterator[Message]:
        try:
            data, whole = self._content(block)
        except DamagedError as error:
            self._damaged(block, str(error))
            return
        at, size = 0, len(data)
        while at + _RECORD.size <= size:
            kind, length = _RECORD.unpack_from(data, at)
            at += _RECORD.size
            if at + length > size or kind == _NOTHING:
                whole = False
                break
            if kind == _MESSAGE and length >= _MESSAGE_HEAD.size:
                channel, _, time, published = _MESSAGE_HEAD.unpack_from(data, at)
                if time > LATEST:
                    self._damaged(block, f"has a message of channel {channel} at {time} ns, which is no time")
                else:
                    self._heard(block, time)
                    if channel not in self._channels:
                        self._unnamed(block, channel)
                    if wanted is None or channel in wanted:
                        raw = data[at + _MESSAGE_HEAD.size : at + length]
                        yield channel, time, raw, published, block.place(at)
            elif kind in (_SCHEMA, _CHANNEL):
                self._note(kind, data[at : at + length])
            at += length
        if not whole or at < size:
            self._damaged(block, "is not whole")

    def _content(self, block: Block) -> tuple[bytes, bool]:
        """The records of a block as far as they can be read, and whether they are whole. Raises `DamagedError`."""
        self._file.seek(block.offset)
        data = self._file.read(block.length)
        if not block.chunk:
            return data, True
        try:
            _, _, size, checksum = _CHUNK_HEAD.unpack_from(data)
            how, at = _string(data, _CHUNK_HEAD.size)
            (length,) = struct.unpack_from("<Q", data, at)
        except (struct.error, UnicodeDecodeError):
            raise DamagedError("has a heading that can't be read") from None
        records = data[at + 8 : at + 8 + length]
        content, whole = decompress(records, how, size)
        if whole and checksum and zlib.crc32(content) != checksum:
            raise DamagedError("differs from its checksum, and was left out")
        return content, whole and len(records) == length

    def _damaged(self, block: Block, what: str) -> None:
        if not self._ended_early or block is not self._blocks[-1]:
            self.damages.append(f"the part at byte {block.offset} {what}")


def _short(data: bytes, at: int) -> int:
    return int(struct.unpack_from("<H", data, at)[0])


def _map(data: bytes, at: int) -> dict[str, str]:
    """The texts by name at a place, as far as they can be read."""
    found: dict[str, str] = {}
    with suppress(struct.error, UnicodeDecodeError):
        (length,) = struct.unpack_from("<I", data, at)
        end, at = at + 4 + length, at + 4
        while at < end:
            name, at = _string(data, at)
            found[name], at = _string(data, at)
    return found


def _string(data: bytes, at: int) -> tuple[str, int]:
    """The text at a place, and the place behind it. Raises struct.error and UnicodeDecodeError."""
    found = _bytes(data, at)
    return found.decode(), at + 4 + len(found)


def _bytes(data: bytes, at: int) -> bytes:
    """The bytes at a place, behind their number: a schema need be no text. Raises struct.error."""
    (length,) = struct.unpack_from("<I", data, at)
    if at + 4 + length > len(data):
        raise struct.error
    return data[at + 4 : at + 4 + length]
