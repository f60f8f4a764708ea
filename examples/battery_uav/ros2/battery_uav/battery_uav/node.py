"""What the three nodes share: how they start, how they are told to go wrong, how they end."""

import signal
from collections.abc import Callable

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import Header

from .logic import known_fault

DEPTH = 100  # messages that a topic keeps for a slow subscriber


def run(make: Callable[[], Node]) -> None:
    """Spin a node until it raises SystemExit, or SIGINT or SIGTERM tells it to stop.

    Both signals are seen between two turns: rclpy's own handlers shut ROS down at once, and a callback
    that is about to publish then fails; a KeyboardInterrupt may come within rclpy's own code.
    """
    told: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: told.append(number))
    ros = rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    with ros, make() as node, SingleThreadedExecutor() as executor:
        executor.add_node(node)
        while not told:
            executor.spin_once(timeout_sec=0.2)


def header(node: Node) -> Header:
    """Return a header stamped with the node's time."""
    return Header(stamp=node.get_clock().now().to_msg())


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

    What is published before a subscription is there is lost to it, and a monitor that misses a
    cause takes its effect for a fault.
    """
    wanted: int = node.declare_parameter("wait_for", default).value
    topics = " and ".join(publisher.topic_name for publisher in publishers)
    node.get_logger().info(f"waiting for {wanted} subscriptions to {topics}")
    return lambda: all(publisher.get_subscription_count() >= wanted for publisher in publishers)
