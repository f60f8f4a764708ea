"""Steps, times, events and values as people are told of them.

A time is the time of day in UTC, as in `12:04:10.300Z`; with its date where it is of another day than the time that it
is told beside; and in seconds, as in `12.500 s`, where it is less than 10^9 s, as simulations and some robots have it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from oracle_server.core.errors import one_line
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.records import VerdictRecord

_SECOND = 10**9
_DAY = 86_400
_LONGEST = 80
"""Characters of a value's text; robots send texts of any length."""


def moment(stamp: int, beside: int | None = None, *, exact: bool = False) -> str:
    """A time (ns) with milliseconds, which it has reached, or `exact` with all that it has beyond them.

    `beside` is the one that it is told beside, None for one of the same day.
    """
    seconds, rest = divmod(stamp, _SECOND)
    digits = next(n for n in (3, 6, 9) if not exact or rest % 10 ** (9 - n) == 0)
    fraction = f"{rest:09}"[:digits]
    if stamp < 10**9 * _SECOND:
        return f"{seconds}.{fraction} s"
    day, second = divmod(seconds, _DAY)
    text = f"{second // 3600:02}:{second // 60 % 60:02}:{second % 60:02}.{fraction}Z"
    if beside is None or beside // _SECOND // _DAY == day:
        return text
    return f"{_date(day)} {text}"


def step_name(number: int | None, stamp: int, beside: int | None = None) -> str:
    """A step by its number and time; by its time alone where it has no number, as a deadline."""
    at = moment(stamp, beside)
    return at if number is None else f"step {number} ({at})"


def first_name(state: Mapping[str, Any], beside: int | None = None) -> str:
    """Where a property's first violation was, by its state as plain data: its step and time; `-` where there is none.

    A deadline has its time only, and what an older version counted its verdict's number only.
    """
    n, number, stamp = (state.get(f"first_violation{key}") for key in ("", "_step", "_at"))
    if n is None:
        return "-"
    if stamp is None:
        return f"#{n}"
    return moment(stamp, beside) if number is None else f"step {number}, {moment(stamp, beside)}"


def event_name(stream: str, kind: str, seq: int, monitor: str, row: int | None = None) -> str:
    """An event by its stream and its number there, and by its row where it has some."""
    return f"{stream} ({kind} {seq} of {monitor}{'' if row is None else f', row {row}'})"


def cause_name(record: VerdictRecord | Mapping[str, Any]) -> str:
    """The late events that a revision was made for, by its record: the first one with its delay, and how many more."""
    cause, *_ = record["because"]
    count, name = record["causes"], event_name(cause["stream"], cause["kind"], cause["seq"], cause["monitor"])
    delay = 0 if cause["stamp"] is None else max(0, record["arrived"] - cause["stamp"]) // 10**6
    late = f"{delay} ms late" if delay else "late"
    return f"{name} came {late}" + (f", and {count - 1} more" if count > 1 else "")


def retraction_text(record: VerdictRecord | Mapping[str, Any]) -> str:
    """That a violation does not stand, and since which late events, by the record of the revision."""
    return f"{record['property']} is not violated at verdict #{record['revises']['from']}: {cause_name(record)}"


def value_text(value: Scalar) -> str:
    """A value as JSON in one line of printable characters; what is cut off a long one is shown as `…`."""
    seen = value[:_LONGEST] if isinstance(value, str) else value  # it may have a million characters
    text = one_line(json.dumps(seen, ensure_ascii=False))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _date(day: int) -> str:
    """The date of a day since 1970, in the calendar whose years begin in March: leap days end them."""
    era, day = divmod(day + 719_468, 146_097)
    year = (day - day // 1460 + day // 36_524 - day // 146_096) // 365
    rest = day - (365 * year + year // 4 - year // 100)
    month = (5 * rest + 2) // 153
    year += 400 * era + (month >= 10)
    return f"{year:04}-{(month + 2) % 12 + 1:02}-{rest - (153 * month + 2) // 5 + 1:02}"
