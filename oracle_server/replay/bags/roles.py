"""What the topics of a bag are for a spec: what nodes asked for, what passed a filter, and the events of services."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.kinds import Kind
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.replay.recording import Note

PROXY = "_mon"
EVENTS = "/_service_event"
"""How the topic of a service's events is named, behind the service."""


class Port(NamedTuple):
    """One of the topics beneath an action: its name, of which kinds its messages are, and their type."""

    topic: str
    kinds: tuple[Kind, ...]
    type: str


class Role(NamedTuple):
    """What the messages of one topic of a bag are.

    They are events of `streams`, one of each kind that the spec has; `asks`: each waited for a decision. What passed
    is on the topic `forwarded`, None where that is not known.

    Of an action, by name, `asked` are the kinds that waited for decisions, and `passes`: its goals are those that
    passed; `port` is what its messages have, and `type` is their type, empty for any.
    """

    streams: tuple[StreamKey, ...]
    asks: bool = False
    forwarded: str | None = None
    action: str = ""
    asked: tuple[Kind, ...] = ()
    passes: bool = False
    port: Port | None = None
    type: str = ""


class Roles(NamedTuple):
    """The roles of a bag's topics, and what is to be said of them."""

    by_topic: dict[str, Role]
    notes: list[Note]


def roles(topics: Mapping[str, int], spec: Spec) -> Roles:
    """The roles of topics, of which the number of messages is given, for a spec."""
    found = Roles({}, [])
    names = {topic.strip("/"): topic for topic in topics}
    services: dict[str, list[StreamSpec]] = {}
    for stream in spec.streams:
        if stream.traits.group == "service":
            services.setdefault(stream.name, []).append(stream)
        elif stream.traits.group == "topic":
            _topic(stream, names, topics, found)
    for streams in services.values():
        _service(streams, names, topics, found)
    return found


def _topic(stream: StreamSpec, names: Mapping[str, str], topics: Mapping[str, int], found: Roles) -> None:
    plain = names.get(stream.name.strip("/"))
    beside = names.get(stream.name.strip("/") + PROXY)
    if stream.action != "filter":
        if plain is not None:
            found.by_topic[plain] = Role((stream.key,))
        return
    at_publisher = stream.intercept == "publisher"
    asked, passed = (beside, plain) if at_publisher else (plain, beside)
    missing = stream.name + PROXY if at_publisher else stream.name
    _filtered((stream.key,), asked, passed, missing, topics, found)


def _service(streams: list[StreamSpec], names: Mapping[str, str], topics: Mapping[str, int], found: Roles) -> None:
    first = streams[0]
    proxy = first.proxy or first.name + PROXY
    served, asked = (names.get((name + EVENTS).strip("/")) for name in (first.name, proxy))
    keys = tuple(stream.key for stream in streams)
    if first.action != "filter":
        topic = served or asked
        if topic is not None:
            found.by_topic[topic] = Role(keys)
    else:
        _filtered(keys, asked, served, f"{proxy}{EVENTS}", topics, found)


def _filtered(
    keys: tuple[StreamKey, ...],
    asked: str | None,
    passed: str | None,
    missing: str,
    topics: Mapping[str, int],
    found: Roles,
) -> None:
    """What was asked is judged where the bag has it, else what passed."""
    if asked is not None and (topics[asked] or passed is None or not topics[passed]):
        found.by_topic[asked] = Role(keys, asks=True, forwarded=passed)
    elif passed is not None:
        found.by_topic[passed] = Role(keys)
        has = "no message on" if asked is not None else "no"
        found.notes.append(only_passed(keys[0].name, f"{has} {missing}"))


def only_passed(stream: str, has: str) -> Note:
    """Says that denied attempts on a stream were not judged, and which topic the recording has not."""
    text = f"{stream}: what passed was judged; the recording has {has}, so denied attempts are not in it"
    return Note(text, doubt=True)
