"""Where a message's publication time stands, in nanoseconds since the epoch."""

from __future__ import annotations

from typing import Any, Callable

_DEFAULTS = ("header.stamp", "stamp")


def stamp_reader(message_type: Any, path: str | None) -> Callable[[Any], int | None]:
    """A function from messages to the time at `path`, or in the usual places; None where it is zero or not there."""
    places = [place for place in ((path,) if path else _DEFAULTS) if _is_time(message_type(), place)]
    if not places:
        return lambda _: None
    names = places[0].split(".")

    def read(message: Any) -> int | None:
        for name in names:
            message = getattr(message, name)
        return message.sec * 10**9 + message.nanosec or None

    return read


def _is_time(message: Any, path: str) -> bool:
    for name in path.split("."):
        message = getattr(message, name, None)
    return hasattr(message, "sec") and hasattr(message, "nanosec")
