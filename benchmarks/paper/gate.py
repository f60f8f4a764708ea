"""Subscribes to /battery_percentage, so that the battery begins once this is there.

A publisher that has found its subscriptions may not have been found by them yet, and its first messages then come
hundreds of ms late; this gives them time.
"""

from __future__ import annotations

import rclpy
from battery_uav_msgs.msg import BatteryPercentage


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("gate")
    node.create_subscription(BatteryPercentage, "battery_percentage", lambda _: None, 1)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
