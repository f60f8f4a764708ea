"""A topic's messages as events, decoded by what is installed or by what their publisher defines."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, Iterator, List, Mapping, Optional, Tuple, Union

import rospy
from oracle_adapter import Stamp, TimeSource
from oracle_adapter.fields import not_there
from oracle_adapter.kept import Beginning
from oracle_adapter.unread import Unread

from oracle_ros1.codec import CodecError, Read, lacking, reader
from oracle_ros1.definitions import Definition, installed_message, ros1_name, sent_definition
from oracle_ros1.headers import Header, header_of, node_of
from oracle_ros1.layout import Screen, screener
from oracle_ros1.stamps import USUAL_STAMPS, Now, misplaced, stamp_reader


@dataclass(frozen=True)
class Decoder:
    """How messages of one definition become events."""

    definition: Definition
    screened: Screen
    """What is to be decoded of a serialized message."""
    read: Read
    stamp: Optional[Callable[[Any], Optional[int]]]
    lacking: str
    """Which fields the spec reads that it does not have."""
    idle: bool
    """Whether nothing of a message is read, so that it need not be decoded."""

    @property
    def digest(self) -> str:
        """The definition's md5sum."""
        return str(self.definition.type._md5sum)  # noqa: SLF001 - genpy's own interface


class Observed:
    """A topic as its messages arrive: their stamp, their publisher, and the fields that are read."""

    def __init__(self, stream: Mapping[str, Any], now: Now, frame: Optional[int] = None) -> None:
        """`frame`: as in `Shared`."""
        self._frame = frame
        self.name: str = stream["name"]
        self.kind: str = stream["kind"]
        self._latency: int = stream["latency"]
        self._type = ros1_name(stream["type"]) if stream["type"] else ""
        self._fields, self._path, self._now = stream["fields"], stream["stamp"], now
        self._reads = stream.get("reads") or ()
        self._beginning = Beginning(now)
        # by type and md5sum, as types of one definition have one md5sum
        self._decoders: Dict[Tuple[str, str], Decoder] = {}
        self._unusable: Dict[Tuple[str, str, str], str] = {}  # why there is none, by what the publisher defines too
        self._refused: Dict[str, str] = {}  # by node, since the last look
        self._unread = Unread()  # under the lock
        self.unreadable: Dict[str, str] = {}
        """Why messages of a node can't be read."""
        self._deciding = threading.Lock()
        found = installed_message(self._type)
        self.installed = self._decoder(found) if found else None

    @property
    def time_source(self) -> Optional[TimeSource]:
        """Where its publication time comes from; None while the type is unknown.

        That of the messages where some version of the type that is published has one, installed or not.
        """
        # a copy: another publisher may just come
        known = [*([self.installed] if self.installed else ()), *list(self._decoders.values())]
        return None if not known else "field" if any(decoder.stamp for decoder in known) else "arrival"

    @property
    def latency(self) -> Optional[int]:
        """How late its messages may be (ns); None where they are stamped here."""
        return None if self.time_source == "arrival" else self._latency

    def decoder(self, header: Header) -> Union[Decoder, str]:
        """What decodes the messages of a publisher with this connection header, or why nothing can."""
        key = header.get("type", ""), header.get("md5sum", "")
        defined = (*key, header.get("message_definition", ""))
        with self._deciding:
            if key not in self._decoders and defined not in self._unusable:
                try:
                    self._decoders[key] = self._found(header)
                except CodecError as error:
                    self._unusable[defined] = str(error)
            found = self._decoders.get(key) or self._unusable[defined]
        return f"nothing of {node_of(header)} can be read: {found}" if isinstance(found, str) else found

    def refuse(self, header: Header, why: str) -> None:
        """Count a message that nothing can decode as lost; the next look tells why."""
        with self._deciding:
            self._unread.add()
            self._refused[node_of(header)] = why

    def event(self, message: rospy.AnyMsg, decoder: Decoder) -> Optional[Tuple[Stamp, Any, int]]:
        """The stamp and the data of a message's event, and how many were lost before it.

        None where it can't be read: then it is one of those, and in `unreadable`. In simulated time rospy has decoded
        /clock, to which it has subscribed by its type.
        """
        if decoder.idle:
            return self._now, {}, self._take_unread() if self._unread else 0
        try:
            decoded, is_too_long = message, False
            if isinstance(message, rospy.AnyMsg):
                screened, is_too_long = decoder.screened(message._buff)  # noqa: SLF001 - rospy's own interface
                decoded = decoder.definition.type().deserialize(screened)
            stamp = decoder.stamp(decoded) if decoder.stamp else None
            data = " " * ((self._frame or 0) + 1) if is_too_long else decoder.read(decoded)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            node = node_of(header_of(message))
            with self._deciding:
                self._unread.add()
                self.unreadable[node] = f"{node} publishes what can't be read: {error}"
            return None
        if stamp and header_of(message).get("latching") == "1" and self._beginning.is_after(stamp):
            stamp = None  # it was kept for who comes later
        return stamp or self._now, data, self._take_unread() if self._unread else 0

    def troubles(self, publishers: Iterable[Header]) -> List[str]:
        """What is wrong with what these publish, by their headers or by their messages."""
        nodes = {node_of(header): self.decoder(header) for header in publishers}
        with self._deciding:
            self.unreadable = {node: why for node, why in self.unreadable.items() if node in nodes}
            refused, self._refused = self._refused, {}
            known = (self.installed, *nodes.values())
            lacking = {found.lacking: None for found in known if isinstance(found, Decoder) and found.lacking}
            found = (*nodes.values(), *refused.values(), *self.unreadable.values(), *self._misplaced(known), *lacking)
            return list(dict.fromkeys(why for why in found if isinstance(why, str)))

    def _misplaced(self, decoders: Iterable[Union[Decoder, str, None]]) -> Iterator[str]:
        """Why messages are not ordered by the field that the spec names."""
        known = [decoder for decoder in decoders if isinstance(decoder, Decoder)]
        if self._path and any(decoder.stamp is None for decoder in known):
            yield misplaced(self._type or "its type", self._path)

    def overdue(self) -> int:
        """How many messages nothing could decode that no event of the topic has told in time, to be told by another."""
        with self._deciding:
            return self._unread.overdue()

    def _take_unread(self) -> int:
        with self._deciding:
            return self._unread.take()

    def _found(self, header: Header) -> Decoder:
        published = header.get("type")
        if self._type and published != self._type:
            raise CodecError(f"it publishes {published or 'what has no type'}, and the spec says {self._type}")
        if self.installed and self.installed.digest == header.get("md5sum"):
            return self.installed
        return self._decoder(sent_definition(header))

    def _decoder(self, found: Definition) -> Decoder:
        stamp = stamp_reader(found.type, self._path)
        read = reader(found.type, self._fields, found.lookup)
        stamps = (self._path,) if self._path else USUAL_STAMPS
        wanted = None if self._fields is None else (*self._fields, *stamps)
        screened = screener(found.type, wanted, found.lookup, self._frame)
        name = f"{found.type._type}"  # noqa: SLF001 - genpy's own interface
        unread = not_there(name, lacking(found.type, self._reads, found.lookup))
        return Decoder(found, screened, read, stamp, unread, idle=stamp is None and self._fields == [])


def deafen(subscriber: rospy.Subscriber) -> None:
    """Have nothing more taken, and ask nobody: to unregister, the master must answer."""
    if subscriber.impl and subscriber.callback is not None:
        callback, subscriber.callback = subscriber.callback, None
        subscriber.impl.remove_callback(callback, subscriber.callback_args)
