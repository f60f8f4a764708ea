"""A frame's text as a message: quickly where it is valid, else slowly, for a message about what is wrong."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain
from typing import Any

import msgspec
from pydantic import TypeAdapter, ValidationError

from oracle_server.core.kinds import GOAL_ID, KINDS, STATUS, Status
from oracle_server.wire.data import DataDecoder, Decoders, careful, decoded, resting, whole
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    MAX_DEPTH,
    MAX_KEYS,
    MAX_PARTS,
    EventMessage,
    Events,
    Incoming,
    Message,
    Quick,
    QuickEvent,
    Raw,
    RawEvent,
    RawEvents,
    why,
)
from oracle_server.wire.json import encode_bytes

_quick: msgspec.json.Decoder[Raw] = msgspec.json.Decoder(Raw)
_quick_event = msgspec.json.Decoder(RawEvent)
_parts = msgspec.json.Decoder(dict[str, msgspec.Raw])
_incoming: TypeAdapter[Message] = TypeAdapter(Incoming)
_event = TypeAdapter(EventMessage)
_anything: msgspec.json.Decoder[Any] = msgspec.json.Decoder()
_HEAD = EventMessage.model_fields.keys() - {"data"}
_NO_DATA = msgspec.Raw()
_UNREADABLE = (msgspec.MsgspecError, ValueError, RecursionError)
_LOWEST, _HIGHEST = -(2**63), 2**64 - 1
_LARGE = 2**14
"""Bytes from which on data is looked through level by level, which is fast where there is much.

What is smaller can't have too many keys, lists or objects.
"""
_TAGS = frozenset({"attach", "events", "outcome", "outcomes", "clock", "report", "detach"})


def decode(text: str, decoders: Decoders = whole) -> Message | Quick:
    """A frame as a message; the events of a batch are left undecoded. Raises `WireError`."""
    try:
        message = _quick.decode(text)
    except _UNREADABLE:
        return _decode_slowly(text, decoders)
    return _with_data(message, decoders) if isinstance(message, RawEvent) else message


def event_in(raw: msgspec.Raw, decoders: Decoders) -> QuickEvent:
    """An undecoded event of a batch, checked. Raises `WireError`."""
    try:
        event = _quick_event.decode(raw)
    except _UNREADABLE:
        return _event_slowly(raw, decoders)
    return _with_data(event, decoders)


def event_of(value: Any, size: int) -> QuickEvent:
    """An event that is decoded already, of a text of `size` bytes, checked. Raises `WireError`."""
    event = _checked(value)
    reason = _unfit(event.data, size)
    if reason is not None:
        raise WireError("bad_event", reason, seq=event.seq)
    return event


def _with_data(event: RawEvent, decoders: Decoders) -> QuickEvent:
    goal_id, status = _marks(event)
    data = _data(event.data, decoders(event.stream, event.kind), event.seq)
    return QuickEvent(
        event.seq, event.stream, data, event.kind, event.stamp, event.ask, event.source, event.call, event.lost,
        goal_id, status,
    )  # fmt: skip


def _marks(event: RawEvent | EventMessage) -> tuple[str | None, Status | None]:
    """The goal's id and status, of kinds that have them. Raises `WireError` where one is missing."""
    marks = KINDS[event.kind].marks
    if not marks:
        return None, None
    goal_id = event.goal_id
    status = event.status if STATUS in marks else None
    missing = GOAL_ID if goal_id is None else STATUS if STATUS in marks and status is None else ""
    if missing:
        raise WireError(
            "bad_event", f"{missing}: missing, and every event of kind `{event.kind}` has one", seq=event.seq
        )
    return goal_id, status


def _data(raw: msgspec.Raw, decoder: DataDecoder, seq: int) -> dict[str, Any]:
    try:
        found = resting(memoryview(raw).nbytes, _decoded_fit, decoder, raw)
    except _UNREADABLE as error:
        if not _is_object(raw):
            raise WireError("bad_event", "data: Input should be a valid dictionary", seq=seq) from None
        raise _malformed(error) from None
    except OverflowError as error:
        raise WireError("bad_event", f"data: {error}", seq=seq) from None
    if isinstance(found, str):
        raise WireError("bad_event", found, seq=seq)
    return found


def _decoded_fit(decoder: DataDecoder, raw: msgspec.Raw) -> dict[str, Any] | str:
    """An event's data, or why it can't be judged: it is let go of here, before the garbage collector looks at it."""
    size = memoryview(raw).nbytes
    data = careful(decoder, raw, size).decode(raw)
    reason = _unfit(data, size)
    return data if reason is None else reason


def _unfit(data: dict[str, Any], size: int) -> str | None:
    """Why an event's data, of so many bytes, can't be judged; None where it can."""
    return _flaw_in_much(data) if size > _LARGE else _flaw(data, MAX_DEPTH)


def _decode_slowly(text: str, decoders: Decoders) -> Message | Quick:
    parts = _parts_of(text)
    if parts is None:
        raise WireError("malformed", "expected a JSON object")
    if "type" in parts and _plain(parts["type"]) == "event":
        return _event_slowly(text, decoders)
    value = _plain(text)
    try:
        message = _incoming.validate_python(value)
    except ValidationError as error:
        raise WireError("malformed", _reason(error), seq=_seq(value)) from None
    if isinstance(message, Events):
        return RawEvents([msgspec.Raw(encode_bytes(event)) for event in message.events])
    return message


def _event_slowly(text: str | msgspec.Raw, decoders: Decoders) -> QuickEvent:
    """An event whose head is checked before its data is decoded, for words about what is wrong."""
    parts = _parts_of(text)
    if parts is None:
        return _checked(None)
    value = {name: _plain(part) for name, part in parts.items() if name in _HEAD}
    raw = parts.get("data", _NO_DATA)
    if raw is not _NO_DATA:
        value["data"] = {} if _is_object(raw) else None
    event = _checked(value)
    data = _data(raw, decoders(event.stream, event.kind), event.seq)
    return msgspec.structs.replace(event, data=data)


def _checked(value: Any) -> QuickEvent:
    try:
        event = _event.validate_python(value)
    except ValidationError as error:
        raise WireError("bad_event", _reason(error), seq=_seq(value)) from None
    goal_id, status = _marks(event)
    return QuickEvent(
        event.seq, event.stream, event.data, event.kind, event.stamp, event.ask, event.source, event.call, event.lost,
        goal_id, status,
    )  # fmt: skip


def _parts_of(text: str | msgspec.Raw) -> dict[str, msgspec.Raw] | None:
    """The values of an object, undecoded; None for anything else. Raises `WireError` where it is no JSON."""
    try:
        return _parts.decode(text)
    except msgspec.ValidationError:
        _plain(text)  # what begins otherwise may be no JSON at all
        return None
    except _UNREADABLE as error:
        raise _malformed(error) from None


def _plain(text: str | msgspec.Raw) -> Any:
    try:
        return decoded(_anything, text)
    except (*_UNREADABLE, OverflowError) as error:
        raise _malformed(error) from None


def _malformed(error: Exception) -> WireError:
    if isinstance(error, RecursionError):
        return WireError("malformed", f"nested more than {MAX_DEPTH} deep")
    return WireError("malformed", f"not JSON: {error}")


def _is_object(raw: msgspec.Raw) -> bool:
    return bytes(memoryview(raw)[:1]) == b"{"


def _flaw(data: dict[str, Any] | list[Any], depth: int) -> str | None:
    """What is nested deeper in data, or an integer of more than 64 bits, in words; None where neither is."""
    if depth == 0:
        return f"data: nested more than {MAX_DEPTH} deep"
    values: Iterable[Any] = data.values() if isinstance(data, dict) else data
    for value in values:
        kind = type(value)
        if kind is int:
            if not _LOWEST <= value <= _HIGHEST:
                return "data: an integer of more than 64 bits"
        elif kind is dict or kind is list:
            flaw = _flaw(value, depth - 1)
            if flaw is not None:
                return flaw
    return None


def _flaw_in_much(data: dict[str, Any]) -> str | None:
    """The same, and what there is too much of, level by level."""
    dicts: list[Any] = [data]
    lists: list[Any] = []
    keys = parts = 0
    for _ in range(MAX_DEPTH):
        keys += sum(map(len, dicts))
        parts += len(dicts) + len(lists)
        if keys > MAX_KEYS:
            return f"data: more than {MAX_KEYS} keys"
        if parts > MAX_PARTS:
            return f"data: more than {MAX_PARTS} lists and objects"
        values = [*chain.from_iterable(map(dict.values, dicts)), *chain.from_iterable(lists)]
        kinds = {*map(type, values)}
        whole_numbers = [v for v in values if type(v) is int] if int in kinds else ()
        if whole_numbers and not _LOWEST <= min(whole_numbers) <= max(whole_numbers) <= _HIGHEST:
            return "data: an integer of more than 64 bits"
        dicts = [v for v in values if type(v) is dict] if dict in kinds else []
        lists = [v for v in values if type(v) is list] if list in kinds else []
        if not dicts and not lists:
            return None
    return f"data: nested more than {MAX_DEPTH} deep"


def _seq(value: Any) -> int | None:
    seq = value.get("seq") if isinstance(value, dict) else None
    return seq if type(seq) is int and 1 <= seq < 2**53 else None


def _reason(error: ValidationError) -> str:
    first = error.errors()[0]
    place = first["loc"][1:] if first["loc"] and first["loc"][0] in _TAGS else first["loc"]
    where = ".".join(str(part) for part in place)
    return f"{where}: {why(first)}" if where else why(first)
