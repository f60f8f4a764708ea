"""`python3 -m oracle_ros2`: attach this machine's ROS 2 graph to an oracle server."""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
from typing import Sequence

import rclpy
from oracle_adapter import Attached, Board, Link, LinkError, Names
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from oracle_ros2.codec import CodecError
from oracle_ros2.graph import dump_graph
from oracle_ros2.monitor import Monitor
from oracle_ros2.screen import Screen
from oracle_ros2.stamps import simulated


def main(arguments: Sequence[str] | None = None) -> int:
    """Run until SIGINT or SIGTERM; 0 after a clean stop, 2 where it can't start or the server refused."""
    own, for_ros = _split(sys.argv if arguments is None else arguments)
    options = _parse(own)
    rclpy.init(args=for_ros, signal_handler_options=SignalHandlerOptions.NO)
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    try:
        return _dump_graph() if options.dump_graph else _run(options, stopping)
    finally:
        rclpy.try_shutdown()


def _split(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """The adapter's own arguments, and those between `--ros-args` and `--`; rcl would take a bare `a:=b` as its own."""
    own: list[str] = []
    for_ros: list[str] = []
    inside = False
    for word in arguments[1:]:
        inside = inside or word == "--ros-args"
        (for_ros if inside else own).append(word)
        inside = inside and word != "--"
    return own, for_ros


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser("oracle_ros2", description=__doc__)
    parser.add_argument("--oracle", default=os.environ.get("ORACLE_URL", "http://127.0.0.1:8642"), help="its address")
    parser.add_argument("--spec", help="the spec to judge by; needed where the session is new")
    parser.add_argument("--session", help="the session to join or make; default a new one of its own")
    parser.add_argument("--monitor", default="monitor", help="this monitor's name (%(default)s)")
    parser.add_argument(
        "--remap", action="append", default=[], metavar="/NAME:=/ROS_NAME", help="what a stream of the spec is here"
    )
    parser.add_argument("--namespace", default="", help="what goes before all names of the spec, such as /uav1")
    parser.add_argument("--token", default=os.environ.get("ORACLE_TOKEN"), help="the server's token")
    parser.add_argument("--dump-graph", action="store_true", help="print the live graph as JSON, and end")
    options = parser.parse_args(arguments)
    try:
        options.names = Names(options.remap, options.namespace)
    except ValueError as error:
        parser.error(str(error))
    return options


def _dump_graph() -> int:
    node = Node("oracle_graph", start_parameter_services=False)
    sys.stdout.write(json.dumps(dump_graph(node), indent=2) + "\n")
    node.destroy_node()
    return 0


def _run(options: argparse.Namespace, stopping: threading.Event) -> int:
    name = options.monitor.strip("/").replace("/", "_").replace("-", "_").replace(".", "_") or "monitor"
    node = Node(name, start_parameter_services=False)  # seven services that every callback would pay for
    log = node.get_logger()
    board = Board(options.monitor, Screen(node, options.monitor))
    failed: list[LinkError] = []

    def on_error(error: LinkError) -> None:
        (log.fatal if error.fatal else log.error)(f"oracle: {error}")
        if error.fatal:
            failed.append(error)
            stopping.set()

    link = Link(
        options.oracle, options.monitor, spec=options.spec or None, session=options.session or None,
        clock="sim" if simulated(node) else "wall", token=options.token, on_error=on_error, on_state=board.on_state,
        on_violation=board.on_violation, on_verdicts=board.on_verdicts,
    )  # fmt: skip
    link.start()
    attached = _wait_attached(link, stopping, options.oracle, node)
    status = 0
    if attached is not None:
        status = _observe(node, link, board, options.names, attached, stopping)
    link.close()
    node.destroy_node()
    return 2 if failed else status


def _wait_attached(link: Link, stopping: threading.Event, url: str, node: Node) -> Attached | None:
    told = False
    while not stopping.is_set():
        try:
            return link.wait_attached(0.5)
        except LinkError as error:
            if error.fatal:
                return None
            if not told:
                node.get_logger().warning(f"waiting for the oracle at {url}: {error}")
                told = True
    return None


def _observe(node: Node, link: Link, board: Board, names: Names, attached: Attached, stopping: threading.Event) -> int:
    unknown = list(names.unused(name for s in attached.streams for name in (s["name"], s.get("proxy") or s["name"])))
    if unknown:
        node.get_logger().fatal(f"--remap {unknown[0]}: {attached.spec} has no such stream")
        return 2
    try:
        monitor = Monitor(node, link, board, names, attached.streams)
    except CodecError as error:
        node.get_logger().fatal(str(error))
        return 2
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    node.get_logger().info(f"observing {len(attached.streams)} streams for session {attached.session}")
    while not stopping.is_set():
        try:
            executor.spin_once(timeout_sec=0.1)
        except ExternalShutdownException:
            break
    monitor.stop()
    executor.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
