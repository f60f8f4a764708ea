"""A session as an MCAP file: its trace, which `replay` reads, and beside it the channels of properties and episodes."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO, NamedTuple

import msgspec
from mcap.writer import Writer

from oracle_server.core.episode import EpisodeRecord
from oracle_server.core.spec import GAP
from oracle_server.foxglove.channels import Channel, Message, Streams, verdict_message
from oracle_server.foxglove.episodes import Recorded
from oracle_server.replay.traces.mcap import PROFILE

_Tell = Callable[[], list[Message]]


class _Known(msgspec.Struct):
    """What there is to learn of a line before any is written."""

    stream: str
    kind: str
    signals: dict[str, str | bool | int | float] = {}


class Beside(NamedTuple):
    """What is told of a session beside its trace, and read once all of that is.

    `changes` are the records at which something is new, `gap` (ns) is that of the spec's episodes.
    """

    changes: Callable[[], Iterable[bytes]]
    episodes: Callable[[], Iterable[EpisodeRecord]]
    gap: int = GAP
    closed: bool = False


def write_mcap(path: Path, lines: Iterable[bytes], beside: Beside) -> int:
    """Write the lines of a session's trace and what is told beside; returns how many lines there are.

    The lines wait in a file without a name beside `path`: a channel says at first which signals its messages have.
    Raises OSError.
    """
    streams, learn, count = Streams(), msgspec.json.Decoder(_Known), 0
    with TemporaryFile(dir=path.parent) as kept, path.open("wb") as file:
        for line in lines:
            known = learn.decode(line)
            streams.learn(known.stream, known.kind, known.signals)
            kept.write(line + b"\n")
            count += 1
        kept.seek(0)
        target = _Target(file)
        for message in _messages(streams, kept, beside):
            target.write(message)
        target.finish()
    return count


def _messages(streams: Streams, lines: Iterable[bytes], beside: Beside) -> Iterator[Message]:
    """All messages; those of streams in the order of the lines, and what was judged meanwhile between them."""
    changes = beside.changes()
    episodes, time = Recorded(beside.episodes(), beside.gap), 0

    def events() -> Iterator[tuple[Message, _Tell]]:
        for line in map(msgspec.json.decode, lines):
            judged = max((place["judged"] for place in line["places"]), default=line["arrived"])
            yield streams.message(line), partial(episodes.passed, line["stamp"], judged)

    def verdicts() -> Iterator[tuple[Message, _Tell]]:
        for record in map(msgspec.json.decode, changes):
            yield verdict_message(record), partial(episodes.take, record)

    for message, tell in heapq.merge(events(), verdicts(), key=lambda found: found[0].time):
        yield message
        yield from tell()
        time = message.time
    yield from episodes.rest(time) if beside.closed else ()


class _Target:
    """A file that is written, and the channels that it has."""

    def __init__(self, file: IO[bytes]) -> None:
        self._writer = Writer(file)
        self._writer.start(profile=PROFILE, library="oracle-server")
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}

    def write(self, message: Message) -> None:
        key = message.channel.topic, message.channel.schema.name
        channel = self._channels.get(key)
        if channel is None:
            channel = self._channels[key] = self._channel(message.channel)
        data = msgspec.json.encode(message.data)
        self._writer.add_message(channel, message.time, data, message.published, message.seq % 2**32)

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]

    def _channel(self, channel: Channel) -> int:
        name, content = channel.schema
        if name not in self._schemas:
            text = msgspec.json.encode(content)
            self._schemas[name] = self._writer.register_schema(name, "jsonschema", text)
        return self._writer.register_channel(channel.topic, "json", self._schemas[name], dict(channel.metadata))
