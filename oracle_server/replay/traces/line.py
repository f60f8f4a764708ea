"""One line of a trace: the project's own, or a flat event of ROSMonitoring's; what is wrong with it, in plain words."""

from __future__ import annotations

import json
import re
from typing import Annotated, Any, NamedTuple, get_args

import msgspec
from msgspec import Meta, Struct

from oracle_server.core.errors import one_line
from oracle_server.core.expression import told
from oracle_server.core.kinds import KINDS, STATUSES, Kind, LineKind, Status
from oracle_server.core.nearest import nearest
from oracle_server.replay.recording import Place, Projected
from oracle_server.wire.flat import decode_object, flat_event

Natural = Annotated[int, Meta(ge=0, le=2**63 - 1)]
MAX_LINE = 64 * 2**20
"""The most bytes of one line."""
_SNIPPET = 20
_TIME = "a time in whole nanoseconds since 1970"
_NUMBER = "a whole number"
_WANTED = {
    "stream": "the name of a topic or service",
    "kind": f"{', '.join(f'`{kind}`' for kind in get_args(Kind)[:-1])} or `{get_args(Kind)[-1]}`",
    "goal_id": "a text of at most 255 characters",
    "status": f"one of {', '.join(STATUSES)}",
    "data": "the message's fields, as an object",
    **dict.fromkeys(("stamp", "arrived", "otherwise", "begun"), _TIME),
    **dict.fromkeys(("seq", "row", "call", "lost"), _NUMBER),
    **dict.fromkeys(("monitor", "source"), "a text"),
}


class Line(Struct):
    """A line in the project's own format; times in nanoseconds since the epoch.

    It has the message as `data`, or its signals as `signals` and `failed`. `otherwise` is the publication time of a
    message that has none itself. `places`, `passed`, `why` and `verdict` are what was recorded about the event live;
    the first line of a session's trace has `begun`, when the session began. `row` is
    which element of its message a line of such a trace stands for. `back`: before it simulated time went back.
    """

    stream: str
    data: dict[str, Any] | None = None
    signals: dict[str, str | bool | int | float] | None = None
    failed: list[str] = []
    kind: LineKind = "topic"
    stamp: Natural | None = None
    arrived: Natural | None = None
    monitor: str = "replay"
    seq: Natural | None = None
    row: Natural | None = None
    source: str = ""
    call: Natural | None = None
    goal_id: Annotated[str, Meta(max_length=255)] | None = None
    status: Status | None = None
    lost: Natural = 0
    ask: bool = False
    otherwise: Natural | None = None
    places: list[Place] = []
    passed: bool | None = None
    why: str | None = None
    verdict: str | None = None
    begun: Natural | None = None
    back: bool = False

    def message(self) -> dict[str, Any] | Projected:
        """The message, or its signals, to ingest. Raises ValueError where the line lacks what its kind has."""
        for mark in KINDS[self.kind].marks:
            if getattr(self, mark) is None:
                raise ValueError(f"the field `{mark}` is missing, which each event of the kind `{self.kind}` has")
        if self.data is not None:
            return self.data
        if self.signals is None:
            raise ValueError("the field `data` is missing")
        return Projected(self.signals, frozenset(self.failed))


_FIELDS = frozenset(Line.__struct_fields__)


class Found(NamedTuple):
    """A line; what is wrong with a time in it that could not be read; and a key that is misspelt. Empty for nothing."""

    line: Line
    fault: str = ""
    misspelt: str = ""


def read_line(text: bytes) -> Found:
    """The line in a text. Raises ValueError where it has no event, whose text says why."""
    try:
        value = decode_object(text)
    except RecursionError:
        raise ValueError("nested too deep") from None
    except json.JSONDecodeError as error:
        raise ValueError(_no_json(error)) from None
    except UnicodeDecodeError:
        raise ValueError("it is not UTF-8 text") from None
    except TypeError:
        raise ValueError("it is no JSON object; write one a line, as {…}") from None
    except UnicodeEncodeError:
        raise ValueError("it has half a surrogate pair, which is no text") from None
    except ValueError as error:
        raise ValueError(f"it has {error}") from None
    own = "stream" in value
    fields, fault = (value, "") if own else _of_flat(value)
    try:
        line = msgspec.convert(fields, Line)
    except msgspec.ValidationError as error:
        raise ValueError(_unfit(fields, str(error))) from None
    line.message()
    return Found(line, fault, _misspelt(fields) if own else "")


def ends_early(text: bytes) -> bool:
    """Whether a text is the beginning of an object, which may end with the `}` of one in it."""
    try:
        decode_object(text)
    except json.JSONDecodeError as error:
        return error.pos >= len(error.doc.rstrip()) or error.msg.startswith("Unterminated string")
    except (ValueError, TypeError, RecursionError):
        return False
    return False


def _of_flat(value: dict[str, Any]) -> tuple[dict[str, Any], str]:
    """The fields of a `Line` from a flat event, and what is wrong with its times."""
    flat = flat_event(value)
    verdict = value.get("verdict")
    line: dict[str, Any] = {"stream": flat.stream, "kind": flat.kind, "data": flat.data, "arrived": flat.time}
    if flat.marks:
        line |= dict(flat.marks) | {key: value[key] for key in ("monitor", "call") if key in value}
    line |= {"otherwise": flat.stamp or flat.time, "verdict": verdict if isinstance(verdict, str) else None}
    times = {"time" if "time" in value else "t": flat.time}
    if "topic" not in value:
        times["stamp"] = flat.stamp
    faults = (
        f"`{key}` is {told(value[key])}"
        for key, read in times.items()
        if read is None and (value.get(key) or (key != "stamp" and value.get(key) == 0))
    )
    return line, next((f"{fault}, and no time in seconds since 1970" for fault in faults), "")


def _misspelt(fields: dict[str, Any]) -> str:
    """A key that is not read, and is much like one that is and is not there."""
    for name in fields.keys() - _FIELDS:
        near = nearest(name, _FIELDS - fields.keys(), alike=0.8)
        if near:
            return f"the key `{one_line(name)}` is not read ({near})"
    return ""


def _no_json(error: json.JSONDecodeError) -> str:
    text = error.doc.rstrip()
    if error.pos >= len(text):
        return f"not JSON: it ends early, at column {len(text)}; an event is one line"
    if text[error.pos] == "\0":
        return (
            f"from column {error.pos + 1} on it has NUL bytes, as where the power failed; delete them, or cut it there"
        )
    snippet = one_line(text[error.pos : error.pos + _SNIPPET])
    if error.msg == "Extra data":
        return (
            f"at column {error.pos + 1} something follows its JSON object: {snippet}; write each on a line of its own"
        )
    return f"not JSON, from column {error.pos + 1} on: {snippet}"


def _unfit(fields: dict[str, Any], reason: str) -> str:
    """Which field is not what it should be."""
    match = re.search(r"`\$\.(\w+)", reason)
    name = match[1] if match else ""
    if name not in fields:
        return reason
    wanted = f"; write {_WANTED[name]}" if name in _WANTED else ", which it can't be"
    return one_line(f"`{name}` is {told(fields[name])}{wanted}{_whole(name, fields[name])}")


def _whole(name: str, value: Any) -> str:
    """The same time in nanoseconds, where it was written in seconds with a fraction."""
    if _WANTED.get(name) != _TIME or not isinstance(value, float) or not 0 <= value < 2**33:
        return ""
    return f", as {round(value * 10**9)} for {value} s"
