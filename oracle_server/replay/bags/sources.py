"""The messages of one topic of a bag as events of a spec's streams."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import msgspec
import zstandard
from rosbags.typesys.store import Typestore

from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import Kind, Status
from oracle_server.core.plan import Plan
from oracle_server.core.stamps import DEFAULT_PATHS, stamp_fault, stamp_in
from oracle_server.replay.bags.definitions import EVENT, event_parts, type_name, type_said, types_of
from oracle_server.replay.bags.messages import message_reader, read_any_text, ros1_decoder
from oracle_server.replay.bags.passing import Filter
from oracle_server.replay.bags.roles import EVENTS, Role
from oracle_server.replay.bags.serviceevents import Calls, Half
from oracle_server.replay.doubts.coverage import signal_names
from oracle_server.replay.files.blocks import ZSTD
from oracle_server.replay.files.storage import Channel
from oracle_server.replay.recording import Projected

_HEADING = 4
"""Bytes before a message in CDR, of which the first two tell how it is written."""
_ORDERS = (b"\0\0", b"\0\1")
"""Big-endian and little-endian."""
_LARGEST = 2**30
"""The most bytes of one message that is decompressed."""
_PADDING = 8
"""A message without lists and texts has fewer bytes than that behind its end."""


class Item(NamedTuple):
    """An event to be: its publication time is in nanoseconds; `asks`: it waited for a decision.

    `passed` is whether it passed then, None where that is not known.
    """

    stream: StreamKey
    stamp: int | None
    data: Any
    call: int | None = None
    asks: bool = False
    passed: bool | None = None
    goal_id: str | None = None
    status: Status | None = None


@dataclass(slots=True)
class Topic:
    """What is known of a topic over all files of a bag.

    `role` is None for a topic on which only what passed `gives` is. Of the `promised` messages `seen` ones were
    read, of which `timed` have a time of recording, and
    `unreadable` could not be decoded, the first for the reason `why`; `bare` ones had no content, and
    `refused` is why those of a channel can't be read at all, empty where they can;
    `timeless` ones no publication time where it should be, the first for the reason `why_timeless`. Its messages
    should be of the type that is `wanted`, empty for any; `types` are those that they have, with how many as far as
    that is known. Beneath an action, `goals` are those of open calls, and `standing` is how they stood in the last
    array of status.
    """

    name: str
    role: Role | None
    asked: Filter | None = None
    gives: Filter | None = None
    events: set[int] = field(default_factory=set)
    calls: Calls | None = None
    promised: int = 0
    seen: int = 0
    timed: int = 0
    unreadable: int = 0
    why: str = ""
    type: str = ""
    wanted: str = ""
    types: dict[str, int] = field(default_factory=dict)
    refused: str = ""
    bare: int = 0
    timeless: int = 0
    why_timeless: str = ""
    denied: set[int] = field(default_factory=set)
    goals: dict[int, str] = field(default_factory=dict)
    standing: dict[str, int] = field(default_factory=dict)

    @property
    def is_service(self) -> bool:
        """Whether the messages are a service's events, and these its calls: a spec may have them as messages."""
        plain = self.role is not None and any(key.kind == "topic" for key in self.role.streams)
        return self.name.endswith(EVENTS) and not plain

    @property
    def surveyed(self) -> bool:
        """Whether all messages must be seen before the first one is judged."""
        passes = self.role is not None and self.role.passes
        return self.is_service or passes or self.asked is not None or self.gives is not None

    def note_timeless(self, why: str) -> None:
        """Note why a message has no publication time, empty where nothing is wrong with it."""
        self.timeless += bool(why)
        self.why_timeless = self.why_timeless or why

    def takes(self, channel: Channel) -> bool:
        """Whether the messages of a channel are of the type that the spec says; which are there is noted."""
        name = channel.type.removesuffix(EVENT) if self.is_service else type_said(channel.type)
        if channel.promised != 0:
            self.types[name] = self.types.get(name, 0) + (channel.promised or 0)
        return not self.wanted or name == self.wanted

    def leave_out(self, channel: Channel) -> None:
        """Note that the messages of a channel are not read."""
        self.promised -= channel.promised or 0
        if channel.promised != 0:
            self.note_unseen(0)

    def note_unseen(self, time: int) -> None:
        """Note that what was asked at a time (ns), or passed then, is not known."""
        if self.asked is not None:
            self.asked.asked(time, None)
        if self.gives is not None:
            self.gives.gave(time, None)

    def note_unreadable(self, why: str) -> None:
        """Note that a message could not be decoded."""
        self.why = self.why or why
        self.unreadable += 1


class Source:
    """Decodes the messages of one channel."""

    def __init__(self, channel: Channel, topic: Topic, ready: Plan, known: Typestore) -> None:
        """Prepare to decode. Raises `TraceError` where the type of the messages is not known."""
        self.topic, self._type = topic, type_name(channel.type)
        topic.type, self.lasts = channel.type, channel.lasts
        types = types_of(channel, known)
        self._decode = decoder(channel, types)
        self._plan = ready
        self._streams = {key.kind: key for key in topic.role.streams} if topic.role else {}
        parts: Mapping[Kind, str] = {"topic": self._type}
        if topic.is_service:
            request, response = event_parts(channel.type)
            parts = {"request": request, "response": response}
        read = partial(message_reader, types, ros1=channel.serialization == "ros1")
        self._read = {kind: read(name, self._fields(kind)) for kind, name in parts.items()}
        whole = topic.asked is not None or topic.gives is not None
        self._whole = {kind: read(name, None) for kind, name in parts.items()} if whole else {}

    def survey(self, time: int, raw: bytes) -> None:
        """Look at a message before all of them are read."""
        decoded = self._decode(raw, self._type)
        if not self.topic.is_service:
            self._note(time, "topic", decoded)
            return
        self.topic.events.add(decoded.info.event_type)

    def survey_calls(self, time: int, raw: bytes) -> None:
        """Look at a service's event once the types of all of them are known."""
        half = self._half(raw)
        if half is not None and half.kind == "request":
            self._note(time, "request", half.content)

    def items(self, raw: bytes, published: Callable[[], int | None]) -> list[Item]:
        """The event that a message is, if it is one. Raises whatever decoding raises.

        `published` says when that was (ns) as the file tells it beside the message, None where it does not.
        """
        item = self._read_one(raw, published)
        return [] if item is None else [item]

    def _read_one(self, raw: bytes, published: Callable[[], int | None]) -> Item | None:
        if self.topic.is_service:
            half = self._half(raw)
            return None if half is None else self._of_service(half)
        key = self._streams["topic"]
        data = self._read["topic"](self._decode(raw, self._type))
        where = self._plan.spec.by_key[key].stamp
        stamp = stamp_in(data, where)
        if stamp is None:
            fault = stamp_fault(data, where)
            self.topic.note_timeless(fault)
            stamp = None if fault else published()
        return self._asking(Item(key, stamp, data))

    def _half(self, raw: bytes) -> Half | None:
        if self.topic.calls is None:
            self.topic.calls = Calls(self.topic.events)
        return self.topic.calls.take(self._decode(raw, self._type))

    def _of_service(self, half: Half) -> Item | None:
        key = self._streams.get(half.kind)
        where = self._plan.spec.by_key[key].stamp if key else None
        data: Any = Projected({}, frozenset(signal_names(self._plan.spec, key))) if key else None
        if half.content is not None:
            data = self._read[half.kind](half.content)
        else:
            self.topic.bare += 1
        stamp = (stamp_in(data, where) if where and half.content is not None else None) or half.stamp
        if half.kind == "response":
            denied = half.call in self.topic.denied
            self.topic.denied.discard(half.call)
            return None if denied or key is None else Item(key, stamp, data, half.call)
        item = self._asking(Item(key or StreamKey("", "request"), stamp, data, half.call))
        if item.passed is False:
            self.topic.denied.add(half.call)
        return item if key else None

    def _asking(self, item: Item) -> Item:
        if self.topic.role is None or not self.topic.role.asks:
            return item
        return item._replace(asks=True, passed=self.topic.asked.take() if self.topic.asked else None)

    def _note(self, time: int, kind: Kind, decoded: Any) -> None:
        content = None if decoded is None else msgspec.json.encode(self._whole[kind](decoded))
        if self.topic.asked is not None:
            self.topic.asked.asked(time, content)
        if self.topic.gives is not None:
            self.topic.gives.gave(time, content)

    def _fields(self, kind: str) -> frozenset[str] | None:
        """The dotted paths of the fields that the spec reads of a message, None for all."""
        key = self._streams.get(kind)  # type: ignore[call-overload]
        return frozenset() if key is None else read_fields(self._plan, key)


def decoder(channel: Channel, types: Typestore) -> Callable[[bytes, str], Any]:
    """What decodes the messages of a channel, of a type by name."""
    if channel.serialization == "ros1":
        return ros1_decoder(types)
    read_any_text(types)
    return partial(read_cdr, types)


def read_cdr(types: Typestore, raw: bytes, name: str) -> Any:
    """A message of a type that was serialized as CDR. Raises ValueError and whatever decoding raises.

    What stands behind its end is no part of it, and may be anything: ROS reserves as many bytes as a message of lists
    and texts has at most, and writes them all. `Typestore.deserialize_cdr` takes that for another type. It may be
    compressed: rosbag2 does so by its metadata alone, and no message begins as these do.
    """
    if raw.startswith(ZSTD):
        raw = _decompressed(raw)
    if len(raw) < _HEADING or raw[:2] not in _ORDERS:
        raise ValueError(f"it is no CDR that is read: it begins with the bytes {raw[:2].hex(' ')}")
    known = types.get_msgdef(name)
    size = len(raw) - _HEADING
    if known.size_cdr and size >= known.size_cdr + _PADDING:
        raise ValueError(f"it has {size} bytes, where each {name} has {known.size_cdr}: its type is another one")
    decode = known.deserialize_cdr_le if raw[1] else known.deserialize_cdr_be
    message, _ = decode(raw[_HEADING:], 0, known.cls, types)
    return message


def _decompressed(raw: bytes) -> bytes:
    """What zstd has compressed. Raises ValueError where it is too large, and `ZstdError`."""
    if zstandard.frame_content_size(raw) > _LARGEST:  # else all that it says is made, whatever the most may be
        raise ValueError(f"it is compressed, and has more than {_LARGEST} bytes")
    return zstandard.ZstdDecompressor(max_window_size=2**27).decompress(raw, max_output_size=_LARGEST)


def read_fields(ready: Plan, key: StreamKey) -> frozenset[str] | None:
    """The dotted paths of the fields that a spec reads of a stream's messages, None for all."""
    fields, stamp = ready.streams[key].fields, ready.spec.by_key[key].stamp
    return None if fields is None else fields | frozenset([stamp.field] if stamp else DEFAULT_PATHS)
