"""Records and plays a ROS 2 bag as `ros2 bag` does, which the wheels lack.

    python tests/ros2/bag.py record FOLDER /topic=package/msg/Type…     until SIGINT
    python tests/ros2/bag.py play FOLDER      with --clock, from before the first message on

It says `recording` when it hears, and ends when all has been played and heard.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import rclpy
from oracle_ros2.codec import load_type
from rclpy.executors import ExternalShutdownException
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock

MESSAGES = Path(__file__).parents[2] / "examples" / "battery_uav" / "ros2" / "battery_uav_msgs" / "msg"
DEPTH = 5000
CLOCK = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
PERIOD = 1 / 40
"""Seconds between two times of `ros2 bag play --clock`."""


def record(folder: Path, topics: dict[str, str]) -> None:
    """Write what is heard into a new bag."""
    types = get_typestore(Stores.ROS2_KILTED)
    for path in MESSAGES.glob("*.msg"):
        types.register(get_types_from_msg(path.read_text(encoding="utf-8"), f"battery_uav_msgs/msg/{path.stem}"))
    node = rclpy.create_node("rosbag2_recorder")
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, kind in topics.items():
            connection = writer.add_connection(topic, kind, typestore=types)

            def write(message: bytes, connection=connection) -> None:  # type: ignore[no-untyped-def]
                writer.write(connection, time.time_ns(), message)

            node.create_subscription(load_type(kind), topic, write, DEPTH, raw=True)
        print("recording", flush=True)
        with suppress(KeyboardInterrupt, ExternalShutdownException):
            rclpy.spin(node)


def play(folder: Path) -> None:
    """Publish a bag's messages at the pace of their recording, and /clock."""
    node = rclpy.create_node("rosbag2_player")
    clock = node.create_publisher(Clock, "/clock", CLOCK)
    with Reader(folder) as reader:
        publishers = {c.topic: node.create_publisher(load_type(c.msgtype), c.topic, DEPTH) for c in reader.connections}
        start, began, over = reader.start_time, None, threading.Event()

        def now() -> int:
            return start if began is None else start + time.monotonic_ns() - began

        def tick() -> None:
            while not over.is_set():
                told = Clock()
                told.clock.sec, told.clock.nanosec = divmod(now(), 10**9)
                clock.publish(told)
                over.wait(PERIOD)

        ticking = threading.Thread(target=tick)
        ticking.start()
        while not all(publisher.get_subscription_count() for publisher in (clock, *publishers.values())):
            time.sleep(PERIOD)
        time.sleep(2 * PERIOD)
        began = time.monotonic_ns()
        for connection, at, message in reader.messages():
            time.sleep(max(0, at - now()) / 10**9)
            publishers[connection.topic].publish(message)
        for publisher in publishers.values():
            publisher.wait_for_all_acked()
        over.set()
        ticking.join()


if __name__ == "__main__":
    rclpy.init()
    what, where, *more = sys.argv[1:]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if what == "record":
        record(Path(where), dict(word.split("=") for word in more))
    else:
        play(Path(where))
    rclpy.try_shutdown()
