"""The adapter with an rclpy that lacks what came after Humble: `python -m tests.ros2.humble` for `-m oracle_ros2`."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any

import rclpy.event_handler
from rclpy.node import Node
from rclpy.subscription import Subscription

LATER = ("rclpy.event_handler", "service_msgs", "service_msgs.msg")
"""Modules that Humble has not, or by another name."""


def main() -> int:
    """Run the adapter as from its command line."""
    old: Any = ModuleType("rclpy.qos_event")
    old.PublisherEventCallbacks = rclpy.event_handler.PublisherEventCallbacks
    old.SubscriptionEventCallbacks = rclpy.event_handler.SubscriptionEventCallbacks
    there = {name: sys.modules.get(name) for name in LATER}
    sys.modules.update({**dict.fromkeys(LATER), "rclpy.qos_event": old})  # type: ignore[dict-item]
    import oracle_ros2.program

    for name, module in there.items():  # what rclpy itself imports later
        if module is None:
            del sys.modules[name]
        else:
            sys.modules[name] = module
    del Node.count_clients, Node.count_services, Subscription.get_publisher_count
    Subscription._callback_type = property(_missing, lambda *_: None)

    from oracle_ros2.__main__ import main as run

    assert oracle_ros2.program
    return run(sys.argv)


def _missing(_: object) -> Any:
    raise AttributeError("_callback_type")


if __name__ == "__main__":
    sys.exit(main())
