"""The wire's messages, as the contract has them: what a monitor sends, checked, and what it is sent."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from oracle_server.core.events import Kind
from oracle_server.core.simulated import TimeBase

SUBPROTOCOL = "oracle.v1"
MAX_FRAME = 2**20
"""Longest frame, in bytes."""
MAX_DEPTH = 64
"""Deepest nesting of an event's data."""
MAX_BATCH = 2**15
"""Most events of one frame: more than fit into one."""
MAX_KEYS = 50_000
"""Most keys of all objects in one event's data."""

Identifier = Annotated[str, Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$")]
MonitorName = Annotated[str, Field(pattern=r"^[~/A-Za-z0-9_][A-Za-z0-9_/.-]*$", max_length=255)]
Stamp = Annotated[int, Field(ge=0, lt=2**63)]
Seq = Annotated[int, Field(ge=1, lt=2**53)]
Count = Annotated[int, Field(ge=0, lt=2**53)]


class _Message(BaseModel):
    model_config = ConfigDict(strict=True, extra="ignore", frozen=True)


class Attach(_Message):
    """The first frame: who the monitor is, and which session it wants."""

    type: Literal["attach"]
    monitor: MonitorName
    instance: Annotated[str, Field(min_length=1, max_length=128)]
    session: Identifier | None = None
    spec: Identifier | None = None
    streams: list[str] | None = None
    clock: TimeBase = "wall"
    verdicts: bool = False
    """Whether it wants to be told how the properties stand, now and after each commit that changes it."""


class EventMessage(_Message):
    """One observed message, request or response."""

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


class QuickEvent(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="event"):
    """The same as `EventMessage`, read in a third of the time; what is refused here is refused there, in words."""

    seq: Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
    stream: Annotated[str, msgspec.Meta(max_length=255)]
    data: dict[str, Any]
    kind: Kind = "topic"
    stamp: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)] | None = None
    ask: bool = False
    source: Annotated[str, msgspec.Meta(max_length=255)] = ""
    call: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] | None = None
    lost: Annotated[int, msgspec.Meta(ge=0, lt=2**53)] = 0


class Events(_Message):
    """A batch; each of its events is checked by itself, so that one bad event refuses no other."""

    type: Literal["events"]
    events: Annotated[list[Any], Field(max_length=MAX_BATCH)]


class QuickEvents(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="events"):
    """The same as `Events` where all are as they should be, as mostly."""

    events: Annotated[list[QuickEvent], msgspec.Meta(max_length=MAX_BATCH)]


Why = Literal["decision", "timeout", "unavailable"]


class Outcome(_Message):
    """What the adapter did after an ask."""

    seq: Seq
    passed: bool
    why: Why


class OutcomeMessage(Outcome):
    """The same, in a frame of its own."""

    type: Literal["outcome"]


class OutcomesMessage(_Message):
    """What the adapter did after several asks."""

    type: Literal["outcomes"]
    outcomes: Annotated[list[Outcome], Field(max_length=MAX_BATCH)]


class ClockStamp(_Message):
    """One stream's word that nothing older will come."""

    stream: str
    kind: Kind = "topic"
    stamp: Stamp


class ClockMessage(_Message):
    """How far a monitor's streams have come."""

    type: Literal["clock"]
    stamps: list[ClockStamp]


TimeSource = Literal["field", "middleware", "arrival"]
"""Where publication time comes from: a field of the message, the middleware's word, or the clock of who received it."""


class StreamReport(_Message):
    """What a monitor says of one of its streams; an empty `trouble` says that nothing is wrong with it."""

    stream: str
    kind: Kind = "topic"
    time_source: TimeSource | None = None
    trouble: Annotated[str, Field(max_length=1000)] = ""


class ReportMessage(_Message):
    """How a monitor's streams are with it; replaces what it said of these streams before."""

    type: Literal["report"]
    streams: list[StreamReport]


class QuickOutcome(msgspec.Struct, frozen=True, gc=False):
    """The same as `Outcome`."""

    seq: Annotated[int, msgspec.Meta(ge=1, lt=2**53)]
    passed: bool
    why: Why


class QuickOutcomes(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="outcomes"):
    """The same as `OutcomesMessage`."""

    outcomes: Annotated[list[QuickOutcome], msgspec.Meta(max_length=MAX_BATCH)]


class QuickStamp(msgspec.Struct, frozen=True, gc=False):
    """The same as `ClockStamp`."""

    stream: str
    stamp: Annotated[int, msgspec.Meta(ge=0, le=2**63 - 1)]
    kind: Kind = "topic"


class QuickClock(msgspec.Struct, frozen=True, gc=False, tag_field="type", tag="clock"):
    """The same as `ClockMessage`."""

    stamps: list[QuickStamp]


class Detach(_Message):
    """The monitor goes; what it sent is still judged."""

    type: Literal["detach"]


Message = Attach | EventMessage | Events | OutcomeMessage | OutcomesMessage | ClockMessage | ReportMessage | Detach
Incoming = Annotated[Message, Field(discriminator="type")]


class WireError(Exception):
    """Something that is answered by an `error` frame; a fatal one closes the connection."""

    def __init__(
        self, code: str, message: str, *, seq: int | None = None, fatal: bool = False, session: str | None = None
    ) -> None:
        super().__init__(message)
        self.code, self.message, self.seq, self.fatal, self.session = code, message, seq, fatal, session

    def frame(self) -> dict[str, Any]:
        """The frame that says so."""
        frame: dict[str, Any] = {"type": "error", "code": self.code, "message": self.message, "fatal": self.fatal}
        more = {"seq": self.seq, "session": self.session}
        return frame | {key: value for key, value in more.items() if value is not None}


AnyEvent = EventMessage | QuickEvent
AnyClock = ClockMessage | QuickClock
Quick = QuickEvent | QuickEvents | QuickOutcomes | QuickClock
_quick: msgspec.json.Decoder[Quick] = msgspec.json.Decoder(Quick)
_incoming: TypeAdapter[Message] = TypeAdapter(Incoming)
_event = TypeAdapter(EventMessage)
_OFTEN = ('{"type":"event",', '{"type":"events",', '{"type":"outcomes",', '{"type":"clock",')
"""How these begin where their writer puts the type first and no blanks, as most do; others are read all the same."""
_LOWEST, _HIGHEST = -(2**63), 2**64 - 1
_INTEGERS = range(_LOWEST, _HIGHEST + 1)
_TAGS = frozenset({"attach", "events", "outcome", "outcomes", "clock", "report", "detach"})


class Frame(NamedTuple):
    """A frame's message; the data of a suspicious one may hold too many keys."""

    message: Message | Quick
    suspicious: bool


def decode(text: str) -> Frame:
    """A frame as a message; the events of a batch are left unchecked where one may be bad. Raises `WireError`."""
    odd = suspicious(text)
    if not odd and text.startswith(_OFTEN):
        try:
            message = _quick.decode(text)
        except (msgspec.MsgspecError, ValueError, RecursionError):
            pass  # to be said in words
        else:
            if _holds_no_misfit(message):
                return Frame(message, odd)
    try:
        value = msgspec.json.decode(text)
    except (msgspec.DecodeError, ValueError) as error:
        raise WireError("malformed", f"not JSON: {error}") from None
    except RecursionError:
        raise WireError("malformed", f"nested more than {MAX_DEPTH} deep") from None
    if not isinstance(value, dict):
        raise WireError("malformed", "expected a JSON object")
    if value.get("type") == "event":
        return Frame(event_of(value, suspicious=odd), odd)
    try:
        return Frame(_incoming.validate_python(value), odd)
    except ValidationError as error:
        raise WireError("malformed", _reason(error), seq=_seq(value)) from None


def suspicious(text: str) -> bool:
    """Whether a frame may carry an event with too many keys."""
    return text.count(":") > MAX_KEYS


def event_of(value: Any, *, suspicious: bool) -> AnyEvent:
    """An event of a batch, checked. Raises `WireError`."""
    if not suspicious:
        with contextlib.suppress(msgspec.ValidationError):  # to be said in words
            quick = msgspec.convert(value, QuickEvent)
            if _fits(quick.data, MAX_DEPTH):
                return quick
    try:
        event = _event.validate_python(value)
    except ValidationError as error:
        raise WireError("bad_event", _reason(error), seq=_seq(value)) from None
    reason = _unfit(event.data)
    if reason:
        raise WireError("bad_event", reason, seq=event.seq)
    return event


def _holds_no_misfit(message: Quick) -> bool:
    if type(message) is QuickEvent:
        return _fits(message.data, MAX_DEPTH)
    return type(message) is not QuickEvents or all(_fits(event.data, MAX_DEPTH) for event in message.events)


def _fits(data: dict[str, Any] | list[Any], depth: int) -> bool:
    """Whether data is nested no deeper, and its integers have no more than 64 bits."""
    if depth == 0:
        return False
    values: Iterable[Any] = data.values() if isinstance(data, dict) else data
    for value in values:
        kind = type(value)
        if kind is int:
            if not _LOWEST <= value <= _HIGHEST:
                return False
        elif (kind is dict or kind is list) and not _fits(value, depth - 1):
            return False
    return True


def encode(frame: Any) -> str:
    """A frame, or any plain value, as JSON text."""
    return encode_bytes(frame).decode()


def encode_bytes(frame: Any) -> bytes:
    """The same in UTF-8."""
    return msgspec.json.encode(frame)


def _unfit(data: dict[str, Any]) -> str | None:
    """Why an event's data can't be judged, None where it can."""
    level: list[Any] = [data]
    keys = 0
    for _ in range(MAX_DEPTH):
        keys += sum(len(outer) for outer in level if isinstance(outer, dict))
        if keys > MAX_KEYS:
            return f"data: more than {MAX_KEYS} keys"
        values = [v for outer in level for v in (outer.values() if isinstance(outer, dict) else outer)]
        if any(type(v) is int and v not in _INTEGERS for v in values):
            return "data: an integer of more than 64 bits"
        level = [v for v in values if isinstance(v, dict | list)]
        if not level:
            return None
    return f"data: nested more than {MAX_DEPTH} deep"


def _seq(value: Any) -> int | None:
    seq = value.get("seq") if isinstance(value, dict) else None
    return seq if type(seq) is int and 1 <= seq < 2**53 else None


def _reason(error: ValidationError) -> str:
    first = error.errors()[0]
    place = first["loc"][1:] if first["loc"] and first["loc"][0] in _TAGS else first["loc"]
    where = ".".join(str(part) for part in place)
    return f"{where}: {first['msg']}" if where else str(first["msg"])
