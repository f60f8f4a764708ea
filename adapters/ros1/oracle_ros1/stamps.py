"""Times in nanoseconds: a message's publication time, and the present time."""

from __future__ import annotations

import time
from typing import Any, Callable, Optional, Sequence

import genpy
import rospy
from oracle_adapter.fields import nanoseconds
from rosgraph_msgs.msg import Clock

from oracle_ros1.codec import attribute

USUAL_STAMPS = ("header.stamp", "stamp")

Now = Callable[[], Optional[int]]


def stamp_reader(message_type: Any, path: Optional[str]) -> Optional[Callable[[Any], Optional[int]]]:
    """A function from messages to the time at `path`, or in the usual places, which gives None where it is zero.

    A number counts as seconds. None where the type has no time there: ROS 1 carries no publication time of its own.
    """
    for place in (path,) if path else USUAL_STAMPS:
        names = place.split(".")
        found = _at(message_type(), names)
        if isinstance(found, genpy.Time):
            return lambda message: _at(message, names).to_nsec() or None
        if isinstance(found, (int, float)) and not isinstance(found, bool):
            return lambda message: nanoseconds(_at(message, names))
    return None


def misplaced(what: str, path: str) -> str:
    """What to say where something has no time at the `path` that the spec names."""
    return f"{what} has no time at `{path}`: ordered by arrival instead"


def wall_now() -> int:
    """The time by the wall clock."""
    return time.time_ns()


def simulated_now() -> Optional[int]:
    """The time of /clock; None before its first message."""
    return rospy.get_rostime().to_nsec() or None


def on_back(call: Callable[[], None]) -> rospy.Subscriber:
    """Call something whenever simulated time goes back, until what is returned is unregistered."""
    newest = genpy.Time()

    def take(clock: Clock) -> None:  # after rospy's own callback, so that its time has gone back already
        nonlocal newest
        before, newest = newest, clock.clock
        if newest < before:
            call()

    return rospy.Subscriber("/clock", Clock, take)


def _at(message: Any, names: Sequence[str]) -> Any:
    for name in names:
        message = getattr(message, attribute(name), None)
    return message
