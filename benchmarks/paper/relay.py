"""Passes /battery_percentage on to /battery_percentage_delayed, each message up to so many ms later, in their order.

python3 -m benchmarks.paper.relay 50
"""

from __future__ import annotations

import random
import sys
import threading
import time
from queue import Queue
from typing import Any

import rclpy
from battery_uav_msgs.msg import BatteryPercentage


def main(jitter: float) -> None:
    rclpy.init()
    node = rclpy.create_node("relay")
    publisher = node.create_publisher(BatteryPercentage, "battery_percentage_delayed", 100)
    queue: Queue[tuple[float, Any]] = Queue()
    delays = random.Random(2024)

    def pass_on() -> None:
        while True:
            due, message = queue.get()
            time.sleep(max(0.0, due - time.monotonic()))
            publisher.publish(message)

    def hear(message: Any) -> None:
        queue.put((time.monotonic() + delays.uniform(0, jitter / 1000), message))

    threading.Thread(target=pass_on, daemon=True).start()
    node.create_subscription(BatteryPercentage, "battery_percentage", hear, 100)
    print("ready", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main(float(sys.argv[1]))
