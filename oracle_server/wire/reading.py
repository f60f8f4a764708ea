"""A frame's text as a message: quickly where it is valid, else slowly, for a message about what is wrong."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from typing import Any, NamedTuple

import msgspec
from pydantic import TypeAdapter, ValidationError

from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    MAX_DEPTH,
    MAX_KEYS,
    AnyEvent,
    EventMessage,
    Incoming,
    Message,
    Quick,
    QuickEvent,
    QuickEvents,
)

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
            pass  # the models below word the error
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
        with contextlib.suppress(msgspec.ValidationError):  # the model below words the error
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
