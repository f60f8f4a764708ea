"""What the three nodes share: how they start, how they are told to go wrong, how they end."""

import signal
from collections.abc import Callable
from contextlib import suppress

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions

from .logic import known_fault

DEPTH = 100  # messages that a topic keeps for a slow subscriber


def run(make: Callable[[], Node]) -> None:
    """Spin a node until it raises SystemExit, or SIGINT or SIGTERM tells it to stop.

    Both signals become a KeyboardInterrupt: rclpy's own handlers shut ROS down at once, and a
    callback that is about to publish then fails.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    ros = rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with suppress(KeyboardInterrupt), ros, make() as node, SingleThreadedExecutor() as executor:
        executor.add_node(node)
        while True:
            executor.spin_once(timeout_sec=0.2)  # a signal is seen between two turns


def fault_of(node: Node) -> str:
    """Return the parameter `fault`: one of `FAULTS`, which may be another node's."""
    return known_fault(str(node.declare_parameter("fault", "none").value))


def when(node: Node, ready: Callable[[], bool], begin: Callable[[], None]) -> None:
    """Call `begin` once, as soon as `ready` says so."""

    def ask() -> None:
        if ready():
            timer.cancel()
            node.get_logger().info("ready")
            begin()

    timer = node.create_timer(0.02, ask)


def heard(node: Node, publishers: list[Publisher], default: int) -> Callable[[], bool]:
    """Return what tells whether each topic has as many subscriptions as `wait_for` names.

    What is published before a subscription is there is lost to it, and a monitor that has not heard
    how the robot stands lets no goal pass.
    """
    wanted: int = node.declare_parameter("wait_for", default).value
    topics = " and ".join(publisher.topic_name for publisher in publishers)
    node.get_logger().info(f"waiting for {wanted} subscriptions to {topics}")
    return lambda: all(publisher.get_subscription_count() >= wanted for publisher in publishers)
