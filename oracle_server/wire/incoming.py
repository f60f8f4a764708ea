"""What a monitor sends, as models: the contract of these frames, and the same in a form that is read faster."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
from pydantic import BaseModel, ConfigDict, Field
from pydantic_core import ErrorDetails

from oracle_server.core.events import TimeBase
from oracle_server.core.kinds import Kind, Status
from oracle_server.core.spec import IDENTIFIER

SUBPROTOCOL = "oracle.v1"
_SHOWN = 80
"""Characters that are repeated of a name that is refused."""
MAX_FRAME = 2**20
"""Longest frame, in bytes."""
MAX_DEPTH = 64
"""Deepest nesting of an event's data."""
MAX_BATCH = 2**15
"""Most events of one frame: more than fit into one."""
MAX_STREAMS = 10_000
"""Most streams that a frame tells of: ten times as many as a spec may have."""
MAX_KEYS = 50_000
"""Most keys of all objects in one event's data."""
MAX_FEATURES = 100
"""Most features that a monitor names."""
REVISIONS = "revisions"
"""The feature of monitors that are told what was revised."""
EPISODES = "episodes"
"""The feature of monitors that are told of episodes in place of violations."""
MAX_PARTS = 100_000
"""The most lists and objects in an event's data: as many as there are where each key holds a list of one object."""

_SESSION = f"{IDENTIFIER[:-1]}(@{IDENTIFIER[1:-1]})?$"
_MONITOR = r"^[~/A-Za-z0-9_][A-Za-z0-9_/.-]*$"
_PLAIN = "1 to 64 letters of ASCII, digits, `_`, `-` and `.`"
_NAMES = {
    IDENTIFIER: f"{_PLAIN}, as in flight_1",
    _SESSION: f"{_PLAIN}, as in flight_1, and at a centre the robot's behind it, as in flight_1@robot7",
    _MONITOR: "letters of ASCII, digits, `_`, `-`, `.` and `/`, and begins with none of `-` and `.`, as in fleet/uav1",
}
"""What names have, by their patterns."""
Identifier = Annotated[str, Field(pattern=IDENTIFIER)]
SessionName = Annotated[str, Field(pattern=_SESSION)]
"""The name of a session, of one that is forwarded too: `s1@robot7`."""
MonitorName = Annotated[str, Field(pattern=_MONITOR, max_length=255)]
Stamp = Annotated[int, Field(ge=0, lt=2**63)]
Seq = Annotated[int, Field(ge=1, lt=2**53)]
Count = Annotated[int, Field(ge=0, lt=2**53)]


def why(error: ErrorDetails) -> str:
    """What is wrong with a value, in words: of a name, what one has."""
    name = _NAMES.get(error.get("ctx", {}).get("pattern", ""))
    return f"{error['input'][:_SHOWN]!r} is no name here: one has {name}" if name else error["msg"]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)


class Attach(_Message):
    """The first frame: who the monitor is, and which session it wants."""

    type: Literal["attach"]
    monitor: MonitorName
    instance: Annotated[str, Field(min_length=1, max_length=128)]
    session: SessionName | None = None
    spec: Identifier | None = None
    streams: Annotated[list[str], Field(fail_fast=True)] | None = None
    clock: TimeBase = "wall"
    verdicts: bool = False
    """Whether it wants `verdicts` frames: how the properties stand, now and after each commit that changes it."""
    features: Annotated[list[str], Field(max_length=MAX_FEATURES, fail_fast=True)] = []
    """What else it knows; unknown words are ignored. `revisions`: `revision` frames, of verdicts put right; `actions`:
    the kinds of actions, without which it can't observe one; `episodes`: `episode` frames in place of `violation`s."""


class EventMessage(_Message):
    """One observed message, request or response, or an event of an action, whose `data` is the inner message.

    All events of actions have a `goal_id`, empty for a cancel of all goals; replies, results and status have `status`.
    """

    type: Literal["event"] = "event"
    seq: Seq
    stream: Annotated[str, Field(max_length=255)]
    kind: Kind = "topic"
    stamp: Stamp | None = None
    data: dict[str, Any]
    ask: bool = False
    source: Annotated[str, Field(max_length=255)] = ""
    call: Count | None = None
    lost: Count = 0
    goal_id: Annotated[str, Field(max_length=255)] | None = None
    status: Status | None = None


class QuickEvent(msgspec.Struct, frozen=True, gc=False):
    """The same as `EventMessage`; of its data may be kept what somebody reads."""

    seq: int
    stream: str
    data: dict[str, Any]
    kind: Kind = "topic"
    stamp: int | None = None
    ask: bool = False
    source: str = ""
    call: int | None = None
    lost: int = 0
    goal_id: str | None = None
    status: Status | None = None


class RawEvent(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="event"):
    """An `EventMessage` with its data undecoded; what is refused here is refused there, with a reason."""

    seq: Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
    stream: Annotated[str, msgspec.Meta(max_length=255)]
    data: msgspec.Raw
    kind: Kind = "topic"
    stamp: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] | None = None
    ask: bool = False
    source: Annotated[str, msgspec.Meta(max_length=255)] = ""
    call: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] | None = None
    lost: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] = 0
    goal_id: Annotated[str, msgspec.Meta(max_length=255)] | None = None
    status: Status | None = None


class Events(_Message):
    """A batch; each of its events is checked by itself, so that one bad event refuses no other."""

    type: Literal["events"]
    events: Annotated[list[Any], Field(max_length=MAX_BATCH)]


class RawEvents(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="events"):
    """The same as `Events`, with its events undecoded."""

    events: Annotated[list[msgspec.Raw], msgspec.Meta(max_length=MAX_BATCH)]


Why = Literal["decision", "timeout", "unavailable"]


class Handling(_Message):
    """What the adapter did after an ask."""

    seq: Seq
    passed: bool
    why: Why


class HandlingMessage(Handling):
    """The same, in a frame of its own."""

    type: Literal["outcome"]


class HandlingsMessage(_Message):
    """What the adapter did after several asks."""

    type: Literal["outcomes"]
    outcomes: Annotated[list[Handling], Field(max_length=MAX_BATCH, fail_fast=True)]


class ClockStamp(_Message):
    """Nothing older than `stamp` will come from one stream."""

    stream: str
    kind: Kind = "topic"
    stamp: Stamp


class ClockMessage(_Message):
    """The clocks of a monitor's streams."""

    type: Literal["clock"]
    stamps: Annotated[list[ClockStamp], Field(max_length=MAX_STREAMS, fail_fast=True)]


TimeSource = Literal["field", "middleware", "arrival"]
"""Where publication time comes from: a field of the message, the middleware, or the clock of the receiver."""


class StreamReport(_Message):
    """The state of one of a monitor's streams; an empty `trouble` means that nothing is wrong with it.

    `bypass` is what of that lets events past the monitor, such as another publisher, and empty where nothing does.
    """

    stream: str
    kind: Kind = "topic"
    time_source: TimeSource | None = None
    trouble: Annotated[str, Field(max_length=1000)] = ""
    bypass: Annotated[str, Field(max_length=1000)] = ""


class ReportMessage(_Message):
    """The state of a monitor's streams; replaces earlier reports of these streams."""

    type: Literal["report"]
    streams: Annotated[list[StreamReport], Field(max_length=MAX_STREAMS, fail_fast=True)]


class QuickHandling(msgspec.Struct, frozen=True, gc=False):
    """The same as `Handling`."""

    seq: Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
    passed: bool
    why: Why


class QuickHandlings(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="outcomes"):
    """The same as `HandlingsMessage`."""

    outcomes: Annotated[list[QuickHandling], msgspec.Meta(max_length=MAX_BATCH)]


class QuickStamp(msgspec.Struct, frozen=True, gc=False):
    """The same as `ClockStamp`."""

    stream: str
    stamp: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    kind: Kind = "topic"


class QuickClock(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="clock"):
    """The same as `ClockMessage`."""

    stamps: Annotated[list[QuickStamp], msgspec.Meta(max_length=MAX_STREAMS)]


class Detach(_Message):
    """The monitor detaches; what it sent is still judged."""

    type: Literal["detach"]


Message = Attach | EventMessage | Events | HandlingMessage | HandlingsMessage | ClockMessage | ReportMessage | Detach
Incoming = Annotated[Message, Field(discriminator="type")]


AnyEvent = EventMessage | QuickEvent
AnyClock = ClockMessage | QuickClock
Quick = QuickEvent | RawEvents | QuickHandlings | QuickClock
Raw = RawEvent | RawEvents | QuickHandlings | QuickClock
