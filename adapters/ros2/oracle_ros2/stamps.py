"""A message's publication time, in nanoseconds since the epoch."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Callable, Sequence

from oracle_adapter.fields import nanoseconds
from rclpy.clock import JumpHandle, JumpThreshold
from rclpy.duration import Duration

if TYPE_CHECKING:
    from oracle_adapter import TimeSource
    from rclpy.node import Node

USUAL_STAMPS = ("header.stamp", "stamp")


def simulated(node: Node) -> bool:
    """Whether a node runs in simulated time."""
    return bool(node.get_parameter("use_sim_time").value)


def time_of(node: Node) -> Callable[[], int]:
    """A function that returns the time by which a node's messages are stamped, in nanoseconds."""
    if not simulated(node):
        return time.time_ns
    clock = node.get_clock()
    return lambda: int(clock.now().nanoseconds)


def on_back(node: Node, call: Callable[[], None]) -> JumpHandle:
    """Call something whenever simulated time goes back, until what is returned is unregistered."""
    threshold = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1), on_clock_change=False)
    return node.get_clock().create_jump_callback(threshold, post_callback=lambda _: call())


def stamp_reader(message_type: Any, path: str | None) -> Callable[[Any], int | None] | None:
    """A function from messages to the time at `path`, or in the usual places; None where there is none.

    A number there counts as seconds. The function's own answer is None where the time is zero, or before the epoch.
    """
    for place in (path,) if path else USUAL_STAMPS:
        names = place.split(".")
        found = _at(message_type(), names)
        if hasattr(found, "sec") and hasattr(found, "nanosec"):
            return lambda message: ros_time(_at(message, names)) or None
        if isinstance(found, int | float) and not isinstance(found, bool):
            return lambda message: nanoseconds(_at(message, names))
    return None


def misplaced(what: str, path: str, source: TimeSource) -> str:
    """What to say where something has no time at the `path` that the spec names, and is ordered by another one."""
    return f"{what} has no time at `{path}`: ordered by {source} instead"


def ros_time(stamp: Any) -> int:
    """A time of ROS in nanoseconds; 0 for one before the epoch."""
    return max(0, int(stamp.sec) * 10**9 + int(stamp.nanosec))


def _at(message: Any, names: Sequence[str]) -> Any:
    for name in names:
        message = getattr(message, name, None)
    return message
