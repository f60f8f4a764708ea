"""The names of sessions that another server forwards: `s1@robot7`. No session is opened by such a name here."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from datetime import UTC, datetime

_AT = "@"


def origin_of(name: str) -> str | None:
    """Which robot a session is forwarded from, by its name; None where it is of this history."""
    _, mark, origin = name.rpartition(_AT)
    return origin if mark else None


def own_name(name: str) -> str:
    """What a session is called where it is forwarded from."""
    return name.rpartition(_AT)[0] or name


def forwarded_name(name: str, origin: str) -> str:
    """What a session is called at the centre."""
    return f"{name}{_AT}{origin}"


def silent_text(origin: str, since: str) -> str:
    """What people are told of a robot that forwards nothing any more; `since` is a time of UTC."""
    return f"'{origin}' was heard last at {since} UTC: what was judged there since then is not known here"


def behind_text(origin: str, rows: int, since: int) -> str:
    """What people are told of a robot that has so many rows still to bring; the oldest is of a time (ns)."""
    told = datetime.fromtimestamp(since // 10**9, UTC).strftime("%Y-%m-%d %H:%M")
    return f"'{origin}' is catching up: of what was judged there since {told} UTC, {rows} rows are still to come"


def deleted_text(origin: str) -> str:
    """What people are told of a session whose end will not come."""
    return (
        f"'{origin}' has deleted it without having forwarded its end: what was judged there, and is not here, is lost"
    )


def copied_text(origin: str) -> str:
    """What people are told of an open session of a robot which forwards to the history that this is a copy of."""
    return (
        f"'{origin}' does not forward to this history, which is a copy: what was judged there since is not known here"
    )


def missing_text(gaps: Iterable[Sequence[int]]) -> str:
    """What people are told of steps that were deleted at a robot before they were forwarded."""
    told = ", ".join(f"{first} to {last}" for first, last in gaps)
    return f"steps at the positions {told} are missing: they were deleted at the robot before they were forwarded"
