"""An action server of `test_msgs/action/Fibonacci`, as a program: it says what reaches it.

    python -m tests.ros2.fibonacci PERIOD [EXPIRY]

A goal has as much feedback as its order says, one a period (s). Orders from 1000 on are rejected, 13 is aborted, and
the goals of orders from 500 on can't be cancelled.
"""

from __future__ import annotations

import signal
import sys
import time
from typing import Any

import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from test_msgs.action import Fibonacci

REJECTED, STUBBORN, ABORTED = 1000, 500, 13


def say(text: str) -> None:
    print(text, flush=True)


def execute(period: float, handle: Any) -> Any:
    order = handle.request.order
    for number in range(order):
        if handle.is_cancel_requested:
            say(f"cancelled {order}")
            handle.canceled()
            return Fibonacci.Result(sequence=[number])
        handle.publish_feedback(Fibonacci.Feedback(sequence=[number]))
        time.sleep(period)
    (handle.abort if order == ABORTED else handle.succeed)()
    say(f"ended {order}")
    return Fibonacci.Result(sequence=list(range(order)))


def accept(goal: Any) -> Any:
    say(f"goal {goal.order}")
    return GoalResponse.REJECT if goal.order >= REJECTED else GoalResponse.ACCEPT


def cancel(handle: Any) -> Any:
    say(f"asked to cancel {handle.request.order}")
    return CancelResponse.REJECT if handle.request.order >= STUBBORN else CancelResponse.ACCEPT


def meet(node: Node, met: set[str] = set()) -> None:  # noqa: B006 - once
    """Say when somebody has come who can send goals."""
    if not met and node.count_clients("/fib/_action/send_goal"):
        met.add("somebody")
        say("ready")


def main() -> None:
    rclpy.init()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    node = Node("fibonacci")
    period, expiry = float(sys.argv[1]), int((sys.argv[2:] or ["10"])[0])
    server = ActionServer(
        node, Fibonacci, "/fib", lambda handle: execute(period, handle), goal_callback=accept, cancel_callback=cancel,
        callback_group=ReentrantCallbackGroup(), result_timeout=expiry, feedback_pub_qos_profile=QoSProfile(depth=1000),
        goal_service_qos_profile=QoSProfile(depth=100), result_service_qos_profile=QoSProfile(depth=100),
    )  # fmt: skip
    if "introspection" in sys.argv:
        from rclpy.service_introspection import ServiceIntrospectionState

        server.configure_introspection(node.get_clock(), QoSProfile(depth=1000), ServiceIntrospectionState.CONTENTS)
    executor = MultiThreadedExecutor(num_threads=30)
    executor.add_node(node)
    node.create_timer(0.05, lambda: meet(node))
    try:
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        server.destroy()
        node.destroy_node()
        say("gone")
        sys.stdout.flush()
        import os

        os._exit(0)  # goals may be under way in threads


if __name__ == "__main__":
    main()
