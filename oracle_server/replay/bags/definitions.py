"""The types of recorded messages, from the definitions in a bag or, where it has none, from those on hand."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.core.errors import OracleError, TraceError, one_line
from oracle_server.replay.bags.bounds import refuse_vast
from oracle_server.replay.files.storage import Channel
from oracle_server.rostypes.bagtypes import NOTHING, is_given

EVENT = "_Event"
"""How the type of a service's events is named, behind the service's."""
RULE = "=" * 80 + "\n"
_INFO = """uint8 event_type
builtin_interfaces/Time stamp
uint8[16] client_gid
int64 sequence_number
"""
_TIME = "int32 sec\nuint32 nanosec\n"
_READ = frozenset({"ros1msg", "ros2msg", "ros2idl", ""})
"""The kinds of definitions that are read, or may be where that is not told; others are known by their name alone."""
_SERIALIZATIONS = frozenset({"cdr", "ros1"})
"""How the messages that are read are serialized."""
_WIDE = re.compile(r"^\s*wstring\b", re.MULTILINE)
_UNREAD = "wstring, which is not read: DDS writes it in several ways, and a recording does not say in which"
TypesByName = dict[str, Any]


class UnreadDefinitionError(OracleError):
    """A definition in a recording that can't be read."""


def types_of(channel: Channel, known: Typestore, given: TypesByName | None = None) -> Typestore:
    """The type of a channel's messages, under `type_name`, and those in it.

    `known` has what the channel does not define itself, and `given` are its own types where they are known already.
    Raises `TraceError` where a type is unknown, or can't be read as the channel defines it: another of its name may be
    laid out otherwise. A folder that was named may have it then. It raises it, too, where messages are serialized in a
    way that is not read, or where it has arrays that no message holds.
    """
    if channel.serialization not in _SERIALIZATIONS:
        raise TraceError(f"{channel.topic}: its messages are in '{channel.serialization[:20]}', which is not read")
    if not channel.type:
        raise TraceError(f"{channel.topic}: the recording does not tell the type of its messages")
    name = type_name(channel.type)
    try:
        own = _defined(channel) if given is None else given
    except UnreadDefinitionError as error:
        if _WIDE.search(lines_of(channel)):
            raise TraceError(f"{channel.topic}: {channel.type} has a field of the type {_UNREAD}") from None
        if not is_given(known, name):
            raise TraceError(f"{channel.topic}: {error}; give the folder of its package with --types") from None
        own = {}
    if name not in own and channel.type.endswith(EVENT):
        own |= _known_event(channel.type, known)
    elif name not in own and name in known.fielddefs:
        own[name] = known.fielddefs[name]
    elif name not in own and channel.encoding == "ros2msg" and not channel.definition.strip():
        own[name] = never_empty(([], []))
    if name not in own:
        raise TraceError(
            f"{channel.topic}: the type {channel.type} is unknown; give the folder of its package with --types"
        )
    complete(own, channel, known)
    refuse_vast(name, own, ros1=channel.serialization == "ros1")
    store = get_typestore(Stores.EMPTY)
    store.register(own)
    return store


def type_name(name: str) -> str:
    """What a type is called among types of messages, as are those of a service's events and of what an action sends."""
    package, divided, rest = name.partition("/")
    if not divided:
        return name
    if "/" not in rest or rest.startswith("action/") or _is_of_events(rest):
        return f"{package}/msg/{rest.rpartition('/')[2]}"
    return name


def type_said(name: str) -> str:
    """What a spec says of the type of a topic's messages."""
    return name if _is_of_events(name.partition("/")[2]) else type_name(name)


def _is_of_events(rest: str) -> bool:
    return rest.startswith("srv/") and rest.endswith(EVENT)


def event_parts(name: str) -> tuple[str, str]:
    """What the requests and the responses in a service's events are named, by the type of the events."""
    package, _, service = name.removesuffix(EVENT).rpartition("/")
    package = package.split("/")[0]
    return f"{package}/msg/{service}_Request", f"{package}/msg/{service}_Response"


def _defined(channel: Channel) -> TypesByName:
    """The types that a channel defines; none where its definition is of a kind that is not read.

    Raises `UnreadDefinitionError` where it is of one that is, and can't be.
    """
    text = lines_of(channel)
    if channel.encoding not in _READ or (not text.strip() and channel.encoding in ("ros2msg", "")):
        return {}
    try:
        if channel.encoding == "ros2idl":
            return _from_idl(text)
        head, *parts = text.split(RULE)
        if channel.type.endswith(EVENT) and "/srv/" in channel.type:
            lines = head.splitlines()
            if "---" not in lines:
                return {}
            at = lines.index("---")
            halves = "\n".join(lines[:at]) + "\n", "\n".join(lines[at + 1 :]) + "\n"
            return _event(channel.type, halves, parts)
        return dict(get_types_from_msg(text, channel.type))
    except Exception as error:  # noqa: BLE001 -- the parser raises anything for a malformed definition
        if not channel.encoding:
            return {}
        reason = one_line(str(error).strip()) or type(error).__name__
        raise UnreadDefinitionError(f"the recording's definition of {channel.type} can't be read: {reason}") from None


def lines_of(channel: Channel) -> str:
    """A channel's definition, whose lines may end as on Windows."""
    return channel.definition.replace("\r\n", "\n")


def _from_idl(text: str) -> TypesByName:
    found: TypesByName = {}
    if not text.startswith(f"{RULE}IDL: "):
        return dict(get_types_from_idl(text))
    for part in text.split(RULE)[1:]:
        found |= get_types_from_idl(part.partition("\n")[2])
    return found


def _event(name: str, halves: tuple[str, str], parts: Iterable[str]) -> TypesByName:
    """The type of a service's events, of the texts of its request and its response and of the types in them."""
    found: TypesByName = {}
    for part, half in zip(event_parts(name), halves, strict=True):
        found |= get_types_from_msg(RULE.join((half, *parts)), part)
        found[part] = never_empty(found[part])
    return found | event_type(name)


def never_empty(definition: Any) -> Any:
    """A definition as it is sent: one without fields has a byte."""
    constants, fields = definition
    return constants, fields or [NOTHING]


def event_type(name: str) -> TypesByName:
    """The type of a service's events, without the types of its requests and responses."""
    request, response = (part.replace("/msg/", "/") for part in event_parts(name))
    text = f"service_msgs/ServiceEventInfo info\n{request}[<=1] request\n{response}[<=1] response\n"
    return {
        **get_types_from_msg(text, type_name(name)),
        **get_types_from_msg(_INFO, "service_msgs/msg/ServiceEventInfo"),
        **get_types_from_msg(_TIME, "builtin_interfaces/msg/Time"),
    }


def _known_event(name: str, known: Typestore) -> TypesByName:
    service = name.removesuffix(EVENT)
    wanted = f"{service}_Request", f"{service}_Response"
    if not all(part in known.fielddefs for part in wanted):
        return {}
    parts = zip(event_parts(name), wanted, strict=True)
    return {part: known.fielddefs[own] for part, own in parts} | event_type(name)


def complete(own: TypesByName, channel: Channel, known: Typestore) -> None:
    """Add the types that others contain. Raises `TraceError` where one is unknown, or is not read."""
    waiting = list(own)
    while waiting:
        whole = waiting.pop()
        for field, kind in own[whole][1]:
            if _is_wide(kind):
                what = f"{channel.topic}: the field `{field}` of {whole} is of the type {_UNREAD}"
                raise TraceError(one_line(what))
            name = _name_in(kind)
            if name is None or name in own:
                continue
            if name not in known.fielddefs:
                what = one_line(f"{channel.topic}: the type {name}, which {channel.type} contains, is unknown")
                raise TraceError(f"{what}; give the folder of its package with --types")
            own[name] = known.fielddefs[name]
            waiting.append(name)


def _is_wide(kind: Any) -> bool:
    """Whether a field has texts of wide characters, which the parser of .msg files takes for a message's name."""
    node, of = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return _is_wide(of[0])
    return str(of).endswith("/wstring") if node == Nodetype.NAME else of[0] == "wstring"


def _name_in(kind: Any) -> str | None:
    """The type that a field contains, None for a plain one."""
    node, of = kind
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        return _name_in(of[0])
    return str(of) if node == Nodetype.NAME else None
