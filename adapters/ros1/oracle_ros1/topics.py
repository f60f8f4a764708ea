"""Topics: those that are only observed, and those whose messages pass when the oracle allows it.

Messages are taken as they were sent, and decoded by what is installed or by what their publisher defines; so any topic
can be observed, and what is forwarded is byte for byte what came.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Union

import rospy
from oracle_adapter import PROXY, Board, Link, Names, TimeSource
from oracle_adapter.passing import Gate, Passing

from oracle_ros1.codec import CodecError, Read, reader
from oracle_ros1.definitions import Definition, installed_message, ros1_name, sent_definition
from oracle_ros1.stamps import Now, stamp_reader

DEPTH = 1000  # messages that wait for a slow subscriber

Header = Mapping[str, str]
Stamp = Union[int, Now]


@dataclass(frozen=True)
class Decoder:
    """How messages of one definition become events."""

    definition: Definition
    read: Read
    stamp: Optional[Callable[[Any], Optional[int]]]
    idle: bool
    """Whether nothing of a message is read, so that it need not be decoded."""


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, and the fields that are read."""

    def __init__(self, stream: Mapping[str, Any], now: Now, board: Board) -> None:
        self.name: str = stream["name"]
        self._board = board
        self.latency: int = stream["latency"]
        self._type = ros1_name(stream["type"]) if stream["type"] else ""
        self._fields, self._path, self._now = stream["fields"], stream["stamp"], now
        self._decoders: Dict[str, Optional[Decoder]] = {}  # by their md5sum; None: told why not
        self._deciding = threading.Lock()
        found = installed_message(self._type)
        self.installed = found and self._decoder(found)

    @property
    def time_source(self) -> Optional[TimeSource]:
        """Where its publication time comes from; None while no publisher has told the type."""
        known = self.installed or next((d for d in self._decoders.values() if d), None)
        return None if known is None else "field" if known.stamp else "arrival"

    def event(self, message: rospy.AnyMsg) -> Optional[Tuple[Stamp, Any, Decoder]]:
        """The stamp, the data and the decoder of a message's event; None where it can't be read, which is told once."""
        decoder = self.decoder(message._connection_header)  # noqa: SLF001 - rospy's own interface
        if decoder is None:
            return None
        if decoder.idle:
            return self._now, {}, decoder
        decoded = decoder.definition.type().deserialize(message._buff)  # noqa: SLF001
        stamp = decoder.stamp(decoded) if decoder.stamp else None
        return stamp or self._now, decoder.read(decoded), decoder

    def decoder(self, header: Header) -> Optional[Decoder]:
        """What decodes the messages of a publisher with this connection header."""
        digest = header["md5sum"]
        with self._deciding:
            if digest not in self._decoders:
                try:
                    self._decoders[digest] = self._found(header)
                except CodecError as error:
                    self._board.error(f"{self.name}: nothing of {header.get('callerid')} can be read: {error}")
                    self._decoders[digest] = None
            return self._decoders[digest]

    def _found(self, header: Header) -> Decoder:
        if self._type and header["type"] != self._type:
            raise CodecError(f"it publishes {header['type']}, and the spec says {self._type}")
        if self.installed and self.installed.definition.type._md5sum == header["md5sum"]:  # noqa: SLF001
            return self.installed
        return self._decoder(sent_definition(header))

    def _decoder(self, found: Definition) -> Decoder:
        stamp = stamp_reader(found.type, self._path)
        read = reader(found.type, self._fields, found.lookup)
        return Decoder(found, read, stamp, idle=stamp is None and self._fields == [])


class LoggedTopic:
    """Reports every message of a topic."""

    def __init__(self, link: Link, board: Board, names: Names, stream: Mapping[str, Any], now: Now) -> None:
        self._link, self.observed = link, Observed(stream, now, board)
        self._subscriber = rospy.Subscriber(names[self.observed.name], rospy.AnyMsg, self._take, tcp_nodelay=True)

    def look(self) -> None:
        """Learn what its publishers say of themselves."""
        for header in headers(self._subscriber):
            self.observed.decoder(header)

    def stop(self) -> None:
        """Take no more."""
        self._subscriber.unregister()

    def _take(self, message: rospy.AnyMsg) -> None:
        event = self.observed.event(message)
        if event is not None:
            stamp, data, _ = event
            self._link.send(self.observed.name, "topic", stamp, data, source=source(message))


class FilteredTopic:
    """Forwards the messages that the oracle allows, in their order; no callback waits for a decision.

    `intercept: publisher` takes X_mon and gives X, `subscriber` takes X and gives X_mon. What it gives can be
    subscribed to at once where the type is installed, else from the moment that the first publisher has connected.
    """

    def __init__(self, link: Link, board: Board, names: Names, stream: Mapping[str, Any], now: Now) -> None:
        self.observed, self._board = Observed(stream, now, board), board
        name, proxy = names[self.observed.name], names[self.observed.name + PROXY]
        self.taken, self.given = (proxy, name) if stream["intercept"] == "publisher" else (name, proxy)
        self._gate = Gate(Passing(link, board, stream), self._forward)
        self._making = threading.Lock()
        self._publisher: Optional[rospy.Publisher] = None
        self._latched = False
        if self.observed.installed:
            self._publish(self.observed.installed, latched=False)
        self._subscriber = rospy.Subscriber(self.taken, rospy.AnyMsg, self._take, tcp_nodelay=True)

    def look(self) -> None:
        """Learn what its publishers say of themselves, so that its subscribers can connect before the first message."""
        for header in headers(self._subscriber):
            decoder = self.observed.decoder(header)
            if decoder:
                self._publish(decoder, latched=header.get("latching") == "1")

    def stop(self) -> None:
        """Take no more; what is decided yet is still forwarded."""
        self._subscriber.unregister()

    def _take(self, message: rospy.AnyMsg) -> None:
        event = self.observed.event(message)
        if event is None:
            return
        stamp, data, decoder = event
        header = message._connection_header  # noqa: SLF001 - rospy's own interface
        self._publish(decoder, latched=header.get("latching") == "1")
        if self._publisher is None or self._publisher.md5sum != header["md5sum"]:
            self._board.trouble(self.observed.name, f"{source(message)} sends another version of {header['type']}")
            return
        self._gate.take(message, stamp, data, source=source(message))

    def _publish(self, decoder: Decoder, *, latched: bool) -> None:
        """Give messages of this definition, unless others are given; latched once one of its publishers is."""
        if self._publisher is not None and self._latched >= latched:
            return
        with self._making:
            made = self._publisher.data_class if self._publisher else decoder.definition.type
            # rospy shares one connection among a topic's publishers: a second one only switches latching on.
            self._publisher = rospy.Publisher(self.given, made, latch=latched, tcp_nodelay=True, queue_size=DEPTH)
            self._latched |= latched

    def _forward(self, message: rospy.AnyMsg) -> None:
        assert self._publisher is not None  # noqa: S101 - made before the message was asked about
        self._publisher.publish(message)


def source(message: rospy.AnyMsg) -> str:
    """Which node published a message."""
    return str(message._connection_header.get("callerid", ""))  # noqa: SLF001 - rospy's own interface


def headers(subscriber: rospy.Subscriber) -> List[Header]:
    """What the publishers that are connected say of themselves."""
    connections = subscriber.impl.connections if subscriber.impl else []
    return [header for header in (c.header for c in connections or []) if header and "md5sum" in header]
