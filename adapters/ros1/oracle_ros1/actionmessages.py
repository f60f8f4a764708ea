"""The messages of an action: five topics, of which each event takes what is inside the envelope."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, Mapping, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatusArray
from oracle_adapter import Stamp, TimeSource
from oracle_adapter.fields import grouped, not_there
from oracle_adapter.interfaces import Stream, is_filtered
from oracle_adapter.passing import Passing, TakeBack

from oracle_ros1.codec import CodecError, lacking, reader
from oracle_ros1.definitions import lookup_installed, ros1_name
from oracle_ros1.headers import Header, header_of, node_of
from oracle_ros1.layout import screener
from oracle_ros1.shared import Shared
from oracle_ros1.stamps import misplaced, stamp_reader
from oracle_ros1.statusarray import ArrayReader

LONGEST = 255
"""The most characters of a goal's id in events."""


class ActionTypes:
    """The classes of an action's messages: those of the five topics, and those inside."""

    def __init__(self, name: str, streams: Mapping[str, Stream], frame: Optional[int] = None) -> None:
        """`name` is that of the action's type, as `pkg/action/Type` or `pkg/Type`. Raises `CodecError`.

        `streams`: what is read of each kind. `frame`: as in `Shared`.
        """
        name = ros1_name(name)
        self.topics: Dict[str, Any] = {"cancel": GoalID, "status": GoalStatusArray}
        self.inner: Dict[str, Any] = {"cancel": GoalID}
        for kind in ("goal", "feedback", "result"):
            self.topics[kind] = _installed(name, kind)
            self.inner[kind] = lookup_installed(f"{name}{kind.capitalize()}")
        self._screens = {
            kind: screener(self.topics[kind], _wanted(kind, streams.get(kind)), lookup_installed, frame)
            for kind in ("goal", "feedback", "result")
        }
        self._made = {kind: type(made.__name__, (made,), {}) for kind, made in self.topics.items()}
        self._statuses = ArrayReader()

    def decoded(self, kind: str, message: rospy.AnyMsg) -> Any:
        """A message of a topic; a status as a `StatusArray`. Raises `CodecError` with the node whose it is.

        A goal, feedback or a result lacks the items of lists that nothing reads, or that no frame holds; whether there
        is such a long one is its `is_too_long`.
        """
        self.check(kind, header_of(message))
        try:
            if kind == "status":
                return self._statuses.read(message)
            return self._read(kind, message._buff)  # noqa: SLF001 - rospy's own interface
        except Exception as error:  # whatever another node sends
            raise CodecError(f"{node_of(header_of(message))} publishes what can't be read: {error}") from error

    def _read(self, kind: str, came: bytes) -> Any:
        if kind == "cancel":
            return GoalID().deserialize(came)
        screened, is_too_long = self._screens[kind](came)
        found = self._made[kind]().deserialize(screened)
        found.is_too_long = is_too_long
        return found

    def check(self, kind: str, header: Header) -> None:
        """Raise `CodecError` where a publisher's messages can't be those of a topic."""
        wanted = self.topics[kind]
        if header.get("md5sum") != wanted._md5sum:  # noqa: SLF001 - genpy's own interface
            name = wanted._type  # noqa: SLF001
            what = f"another version of {name} than is installed here"
            if header.get("type") != name:
                what = f"{header.get('type') or 'what has no type'}, and the spec says {name}"
            raise CodecError(f"nothing of {node_of(header)} can be read: it publishes {what}")


class ActionStream:
    """The events of one kind of an action."""

    def __init__(self, shared: Shared, stream: Stream, types: ActionTypes, *, proxied: bool) -> None:
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.passing: Optional[Passing] = None
        self.trouble = ""
        """What is wrong with it for as long as the adapter runs."""
        if is_filtered(stream) and self.kind == "reply":
            self.trouble = "replies are not decided on: on ROS 1 a server's status tells of them, when it is too late"
        elif is_filtered(stream):
            self.passing = Passing(shared.link, shared.board, stream, shared.clocks)
        inner, outer, path = types.inner.get(self.kind), types.topics.get(self.kind), stream["stamp"]
        self._now = shared.now
        self._read, self._blank = _reader(inner, stream), " " * ((shared.frame or 0) + 1)
        named = stamp_reader(inner, path) if inner and path else None
        sent = stamp_reader(outer, "header.stamp") if outer and not proxied else None
        self._stamp: Optional[Callable[[Any, Any], Optional[int]]] = None
        if named:
            self._stamp = lambda _message, found: named(found)
        elif sent:
            self._stamp = lambda message, _found: sent(message)
        if path and not named:
            self.trouble = misplaced(f"its {self.kind}", path)
        if inner is not None:
            unread = lacking(inner, stream.get("reads") or (), lookup_installed)
            self.trouble = self.trouble or not_there(f"the {self.kind} of {stream['type']}", unread)
        self.time_source: TimeSource = "field" if self._stamp else "arrival"
        self.latency: Optional[int] = stream["latency"] if self._stamp else None

    def data(self, message: Any, found: Any) -> Any:
        """What is read of what is inside a message; blanks where no frame holds that."""
        return self._blank if getattr(message, "is_too_long", False) else self._read(found)

    def stamp(self, message: Any, found: Any) -> Stamp:
        """The time of a message, by what is inside it or by itself; or what reads the clock as it is queued."""
        return (self._stamp(message, found) if self._stamp else None) or self._now


def _installed(name: str, kind: str) -> Any:
    """The class of one of an action's topics. Raises `CodecError`."""
    try:
        return lookup_installed(f"{name}Action{kind.capitalize()}")
    except CodecError as error:
        if not name.endswith("Action"):
            raise
        package, _, action = name[: -len("Action")].partition("/")
        hint = f"The type of an action is called as its file is, as {package}/action/{action}, and not {name}"
        raise CodecError(f"{error} {hint}") from error


def _wanted(kind: str, stream: Optional[Stream]) -> Optional[Iterable[str]]:
    """The dotted paths into a topic's messages that are read of them; None for all."""
    if stream is None:
        return []
    fields, stamps = stream["fields"], filter(None, [stream["stamp"]])
    return None if fields is None else [f"{kind}.{path}" for path in (*fields, *stamps)]


def _reader(inner: Any, stream: Stream) -> Callable[[Any], Any]:
    """Of a kind that is no message: a reply is a mapping, a status nothing."""
    fields = stream["fields"]
    if inner is not None:
        return reader(inner, fields, lookup_installed)
    wanted: Optional[Mapping[str, Any]] = None if fields is None else grouped(fields)
    return lambda found: {name: value for name, value in found.items() if wanted is None or name in wanted}


def text_of(goal_id: str) -> str:
    """A goal's id as events have it: one that is too long keeps its beginning, and ends with a digest of it."""
    if len(goal_id) <= LONGEST:
        return goal_id
    digest = hashlib.sha256(goal_id.encode()).hexdigest()
    return goal_id[: LONGEST - len(digest)] + digest


def with_id(goal: Any, message: rospy.AnyMsg, goal_id: str) -> rospy.AnyMsg:
    """A goal that came without an id, as a message that has this one; the goal has it, too.

    Servers would give it one that nobody knows who has sent the goal. All else is left byte for byte as it came.
    """
    goal.goal_id.id = goal_id
    came: bytes = message._buff  # noqa: SLF001 - rospy's own interface
    (frame,) = struct.unpack_from("<I", came, 12)  # the length of the header's `frame_id`, behind `seq` and `stamp`
    at, text = 16 + frame + 8, goal_id.encode()  # behind the time of the goal's id
    made = rospy.AnyMsg()
    made._connection_header = header_of(message)  # noqa: SLF001
    made._buff = came[:at] + struct.pack("<I", len(text)) + text + came[at + 4 :]  # noqa: SLF001
    return made


@dataclass(eq=False)
class Goal:
    """A goal that the server has not got yet."""

    number: int
    goal_id: GoalID
    message: rospy.AnyMsg
    allowed: Optional[float] = None
    """Since when it may go to the server (s)."""
    take_back: Optional[TakeBack] = None
    """Reports that it has not passed after all; None where that was not asked about."""

    def may_be_taken_back(self, take_back: TakeBack) -> None:
        """Note what reports that it has not passed after all."""
        self.take_back = take_back


@dataclass(eq=False)
class Said:
    """A cancel, feedback or a result on its way."""

    number: int
    message: rospy.AnyMsg
    found: Any


def covers(cancel: GoalID, goal: GoalID) -> bool:
    """Whether a cancel is about a goal, as servers read it."""
    if not cancel.id and not cancel.stamp:
        return True
    return bool(cancel.id and cancel.id == goal.id) or bool(cancel.stamp and goal.stamp <= cancel.stamp)
