"""A topic's messages as events, decoded by what is installed or by what their publisher defines."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Union

import rospy
from oracle_adapter import TimeSource

from oracle_ros1.codec import CodecError, Read, reader
from oracle_ros1.definitions import Definition, installed_message, ros1_name, sent_definition
from oracle_ros1.stamps import Now, stamp_reader

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

    @property
    def digest(self) -> str:
        """The definition's md5sum."""
        return str(self.definition.type._md5sum)  # noqa: SLF001 - genpy's own interface


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, and the fields that are read."""

    def __init__(self, stream: Mapping[str, Any], now: Now) -> None:
        self.name: str = stream["name"]
        self.latency: int = stream["latency"]
        self._type = ros1_name(stream["type"]) if stream["type"] else ""
        self._fields, self._path, self._now = stream["fields"], stream["stamp"], now
        self._decoders: Dict[str, Union[Decoder, str]] = {}  # by their md5sum; a text says why there is none
        self._deciding = threading.Lock()
        found = installed_message(self._type)
        self.installed = self._decoder(found) if found else None

    @property
    def time_source(self) -> Optional[TimeSource]:
        """Where its publication time comes from; None while no publisher has told the type."""
        known = self.installed or next((d for d in self._decoders.values() if isinstance(d, Decoder)), None)
        return None if known is None else "field" if known.stamp else "arrival"

    def decoder(self, header: Header) -> Union[Decoder, str]:
        """What decodes the messages of a publisher with this connection header, or why nothing can."""
        digest = header["md5sum"]
        with self._deciding:
            if digest not in self._decoders:
                try:
                    self._decoders[digest] = self._found(header)
                except CodecError as error:
                    self._decoders[digest] = f"nothing of {header.get('callerid')} can be read: {error}"
            return self._decoders[digest]

    def event(self, message: rospy.AnyMsg, decoder: Decoder) -> Tuple[Stamp, Any]:
        """The stamp and the data of a message's event."""
        if decoder.idle:
            return self._now, {}
        decoded = decoder.definition.type().deserialize(message._buff)  # noqa: SLF001 - rospy's own interface
        stamp = decoder.stamp(decoded) if decoder.stamp else None
        return stamp or self._now, decoder.read(decoded)

    def _found(self, header: Header) -> Decoder:
        if self._type and header["type"] != self._type:
            raise CodecError(f"it publishes {header['type']}, and the spec says {self._type}")
        if self.installed and self.installed.digest == header["md5sum"]:
            return self.installed
        return self._decoder(sent_definition(header))

    def _decoder(self, found: Definition) -> Decoder:
        stamp = stamp_reader(found.type, self._path)
        read = reader(found.type, self._fields, found.lookup)
        return Decoder(found, read, stamp, idle=stamp is None and self._fields == [])


def header_of(message: rospy.AnyMsg) -> Header:
    """What the publisher of a message says of itself."""
    header: Header = message._connection_header  # noqa: SLF001 - rospy's own interface
    return header


def headers(subscriber: rospy.Subscriber) -> List[Header]:
    """What the publishers that are connected say of themselves."""
    connections = subscriber.impl.connections if subscriber.impl else []
    return [header for header in (c.header for c in connections or []) if header and "md5sum" in header]
