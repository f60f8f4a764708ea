"""Subscribes to /battery_percentage once told so by a line, so that the battery begins then, with all else in place.

A process that joins the graph can keep those that are there from hearing for some 100 ms, and a publisher that has
found its subscriptions may not have been found by them yet: so this joins early, and what it adds later is little.
"""

from __future__ import annotations

import sys

import rclpy
from battery_uav_msgs.msg import BatteryPercentage


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("gate")
    print("ready", flush=True)
    sys.stdin.readline()
    node.create_subscription(BatteryPercentage, "battery_percentage", lambda _: None, 1)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
