"""ROSMonitoring's flat events: a message's fields beside `topic` and `time`, or a service's `request` or `response`.

Those of actions are the project's own: `ros_action`, `kind`, `goal_id`, `status` where there is one, and `data`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Container, Mapping
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.events import Step, StreamKey
from oracle_server.core.kinds import ACTION, KINDS, OF_ACTIONS, Kind
from oracle_server.core.stamps import nanoseconds
from oracle_server.wire.data import decoded

_anything: msgspec.json.Decoder[Any] = msgspec.json.Decoder()


class FlatEvent(NamedTuple):
    """One flat event; `time` is when its monitor observed it, `stamp` the publication time of a call, both in ns.

    `marks` are what an action's event has beside its message; whether they are sound is for others to say.
    """

    stream: str
    kind: Kind
    data: Any
    time: int | None
    stamp: int | None
    marks: Mapping[str, Any] = {}


def decode_object(text: bytes | str) -> dict[str, Any]:
    """A JSON object. Raises ValueError (msgspec's errors are some), TypeError or RecursionError.

    Old monitors write NaN and infinities bare; they become the strings that the wire has for them.
    """
    try:
        value = decoded(_anything, text if isinstance(text, str) else text.decode())
    except OverflowError as error:
        raise ValueError(str(error)) from None
    except msgspec.DecodeError:
        value = _leniently(text)
        msgspec.json.encode(value)  # half a surrogate pair, which json reads, could not be kept
    if not isinstance(value, dict):
        raise TypeError("expected a JSON object")
    return value


def _leniently(text: bytes | str) -> Any:
    try:
        # as text: of bytes with NUL among the first json takes another encoding
        return json.loads(text if isinstance(text, str) else text.decode("utf-8-sig"), parse_constant=str)
    except json.JSONDecodeError:
        raise
    except ValueError:  # Python's own words name a setting that nobody can set here
        raise ValueError(f"a whole number with more than {sys.get_int_max_str_digits():,} digits") from None


def flat_event(value: Mapping[str, Any]) -> FlatEvent:
    """Read a flat event. Raises ValueError where it is none."""
    time = nanoseconds(value.get("time", value.get("t")))
    topic, service = value.get("topic"), value.get("service")
    if isinstance(topic, str):
        data = {k: v for k, v in value.items() if k not in ("topic", "time")}
        return FlatEvent(topic, "topic", data, time, None)
    action = value.get(ACTION)
    kind: Kind | None = next((kind for kind in OF_ACTIONS if kind == value.get("kind")), None)
    if isinstance(action, str) and kind is not None:
        marks = {mark: value.get(mark) for mark in KINDS[kind].marks}
        return FlatEvent(action, kind, value.get("data", {}), time, nanoseconds(value.get("stamp")), marks)
    kind = "response" if "response" in value else "request"
    if kind in value and isinstance(service, str):
        return FlatEvent(service, kind, value[kind], time, nanoseconds(value.get("stamp")))
    raise ValueError(
        "it has neither `stream`, nor `topic`, nor `service` with a `request` or `response`, nor `ros_action` with a "
        "`kind` of actions"
    )


def as_flat(step: Step, name: str, time: int) -> dict[str, Any]:
    """The flat event of a step at a time (ns), under the name that its stream is to have.

    Raises TypeError where the event has only the signals of its message. A topic's own fields `topic` and
    `time` have no place in a flat event.
    """
    data, kind = step.event.data, step.event.stream.kind
    if not isinstance(data, dict):
        raise TypeError("the message was not kept")
    traits = KINDS[kind]
    head = {traits.group: name, "time": time / 10**9}
    if traits.marks:
        return {**head, "kind": kind, **step.event.marks, "data": data}
    return {**head, **{k: v for k, v in data.items() if k not in head}} if traits.sole else head | {kind: data}


def find_stream(name: str, kind: Kind, streams: Container[StreamKey]) -> StreamKey | None:
    """The stream of that name; old monitors may leave the leading slash out, and so may specs."""
    bare = name.removeprefix("/")
    return next((key for n in (name, f"/{bare}", bare) if (key := StreamKey(n, kind)) in streams), None)
