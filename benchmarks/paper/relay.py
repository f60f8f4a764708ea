"""Passes the robot's topics on to the monitor, under the names TOPIC_delayed, and later than they came.

    python3 -m benchmarks.paper.relay 50        # /battery_percentage, each message up to 50 ms later
    python3 -m benchmarks.paper.relay 50 7      # all topics, held back by the stalls of seed 7 too (0: by none)

Messages of one topic stay in their order. The stalls begin with the first percentage; each is told of at its end.
"""

from __future__ import annotations

import random
import sys
import threading
import time
from collections import Counter
from collections.abc import Sequence
from queue import Queue
from typing import Any

import rclpy
from battery_uav_msgs import msg
from rclpy.node import Node

from benchmarks.paper.stalls import LINKS, Stall, passing, schedule

TYPES = {
    "battery_percentage": msg.BatteryPercentage,
    "input_accepted": msg.InputAccepted,
    "battery_status": msg.BatteryStatus,
    "LED_panel": msg.LedPanel,
    "status_accepted": msg.StatusAccepted,
}
JITTERED = "battery_percentage"
DEPTH = 100


class Relay:
    """All topics that are passed on, and the stalls, whose time begins with the first percentage."""

    def __init__(self, node: Node, jitter: float, stalls: Sequence[Stall] | None) -> None:
        """Without stalls, not even an empty list of them, only the percentages are passed on."""
        self._jitter, self._stalls = jitter, stalls or ()
        self._delays = random.Random(2024)
        self._held: Counter[Stall] = Counter()
        self._began: float | None = None
        for link, topics in LINKS.items():
            for topic in {JITTERED} & set(topics) if stalls is None else topics:
                self._pass_on(node, link, topic)

    def _pass_on(self, node: Node, link: str, topic: str) -> None:
        publisher = node.create_publisher(TYPES[topic], f"{topic}_delayed", DEPTH)
        queue: Queue[tuple[float, Any]] = Queue()

        def send() -> None:
            while True:
                due, message = queue.get()
                time.sleep(max(0.0, due - time.monotonic()))
                publisher.publish(message)

        def hear(message: Any) -> None:
            delay = self._delays.uniform(0, self._jitter) if topic == JITTERED else 0.0
            queue.put((self._due(link, time.monotonic() + delay), message))

        threading.Thread(target=send, daemon=True).start()
        node.create_subscription(TYPES[topic], topic, hear, DEPTH)

    def _due(self, link: str, due: float) -> float:
        if self._began is None:
            if link != "battery":
                return due
            self._began = time.monotonic()
            threading.Thread(target=self._tell, daemon=True).start()
        passes, stall = passing(due - self._began, link, self._stalls)
        if stall is not None:
            self._held[stall] += 1
        return self._began + passes

    def _tell(self) -> None:
        assert self._began is not None
        for stall in sorted(self._stalls, key=lambda s: s.end):
            time.sleep(max(0.0, self._began + stall.end - time.monotonic()))
            print(f"stall of {stall.held}: {stall.end - stall.start:.3f} s, held {self._held[stall]}", flush=True)
        print("no more stalls", flush=True)


def main(jitter: float, seed: int | None) -> None:
    rclpy.init()
    node = rclpy.create_node("relay")
    Relay(node, jitter / 1000, None if seed is None else schedule(seed))
    print("ready", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main(float(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else None)
