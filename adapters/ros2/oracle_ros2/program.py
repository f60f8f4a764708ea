"""The adapter from its command line to its end."""

from __future__ import annotations

import argparse
import json
import os
import sys
import threading
from typing import TYPE_CHECKING, Any, Callable, Sequence, TypeVar

import rclpy
from oracle_adapter import Board, LinkError, Names, graph_name, open_log
from oracle_adapter.command import close, default, demand_one_oracle, make_link, parser, wait_attached
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from oracle_ros2.codec import CodecError
from oracle_ros2.graph import doubled, dump_graph
from oracle_ros2.loop import Loop
from oracle_ros2.monitor import Monitor
from oracle_ros2.screen import Screen
from oracle_ros2.stamps import simulated

if TYPE_CHECKING:
    from oracle_adapter import Link

T = TypeVar("T")


def run(arguments: Sequence[str], stopping: threading.Event) -> int:
    """Run until `stopping` is set; 0 after a clean stop, 2 where it can't start or the server refused."""
    own, for_ros = _split(arguments)
    options = _parse(own)
    _see_all()
    _started(lambda: rclpy.init(args=for_ros, signal_handler_options=SignalHandlerOptions.NO))
    try:
        return _dump_graph(stopping) if options.dump_graph else _attach(options, stopping)
    finally:
        rclpy.try_shutdown()


def _see_all() -> None:
    """Have a discovery server of Fast DDS tell who else publishes what this node does, and calls what it serves.

    It tells its usual clients only of those that they exchange messages with.
    """
    if os.environ.get("ROS_DISCOVERY_SERVER"):
        os.environ["ROS_SUPER_CLIENT"] = "TRUE"


def _started(make: Callable[[], T]) -> T:
    """What ROS makes, or the end of the program with 2 where its arguments or its settings do not let it."""
    try:
        return make()
    except (RuntimeError, NameValidationException, ParameterException) as error:  # rcl's errors are of the first class
        text = str(error).partition(", at /")[0]
        sys.stderr.write(f"oracle_ros2: error: ROS does not start: {type(error).__name__}: {text}\n")
        sys.exit(2)


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


def _is_for_ros(word: str) -> bool:
    return word in ("-r", "-p", "--param", "--params-file", "--enclave", "--log-level") or ":=" in word


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    options = parser("oracle_ros2", "Attach this machine's ROS 2 graph to an oracle server.")
    options.add_argument("--dump-graph", action="store_true", help="print the live graph as JSON, and end")
    given, unknown = options.parse_known_args(arguments)
    if unknown:
        where = "; ROS's own arguments, as -r, -p and --params-file, stand behind --ros-args"
        options.error(f"unrecognized arguments: {' '.join(unknown)}{where if any(map(_is_for_ros, unknown)) else ''}")
    try:
        demand_one_oracle(given)
    except ValueError as error:
        options.error(str(error))
    for name, value in vars(given).items():
        setattr(given, name, value or default(name))
    try:
        given.names = Names(given.remap or (), given.namespace or "")
    except ValueError as error:
        options.error(str(error))
    return given


def _dump_graph(stopping: threading.Event) -> int:
    node = _started(lambda: Node("oracle_graph", start_parameter_services=False))
    graph = dump_graph(node, stopping.is_set)
    if graph is None:
        node.get_logger().error("ended before the graph was there: nothing is printed")
        return 2
    sys.stdout.write(json.dumps(graph, indent=2) + "\n")
    for name in doubled(node):
        node.get_logger().warning(
            f"several nodes are named {name}: the graph has only what one of them publishes, subscribes, serves and "
            "calls; give each a name of its own, by --ros-args -r __node:=NAME"
        )
    node.destroy_node()
    return 0


def _attach(options: argparse.Namespace, stopping: threading.Event) -> int:
    name = graph_name(options.monitor).strip("/").replace("/", "_")
    # without seven services that every callback would pay for
    node = _started(lambda: Node(name, start_parameter_services=False))
    log = node.get_logger()
    board = Board(options.monitor, _started(lambda: Screen(node, options.monitor)))
    failed: list[LinkError] = []

    def on_error(error: LinkError) -> None:
        (log.fatal if error.fatal else log.error)(f"oracle: {error}")
        if error.fatal:
            failed.append(error)
            stopping.set()

    def linked() -> Any:
        if options.log and not options.embedded:
            return open_log(options.log, options.streams, options.monitor, board.on_state, on_error)
        return make_link(
            options, clock="sim" if simulated(node) else "wall", on_error=on_error, on_state=board.on_state,
            on_violation=board.on_violation, on_verdicts=board.on_verdicts,
            on_revision=board.on_revision, on_episode=board.on_episode, features=["actions"],
        )  # fmt: skip

    try:
        link = linked()
        link.start()
        try:
            _observe(node, link, board, options.names, stopping)
        finally:
            close(link, log.error)
    except (CodecError, LinkError, ValueError) as error:
        log.fatal(str(error))
        return 2
    finally:
        node.destroy_node()
    return 2 if failed else 0


def _observe(node: Node, link: Link, board: Board, names: Names, stopping: threading.Event) -> None:
    """Observe what the server names until `stopping` is set. Raises `CodecError`, or ValueError for a bad remap."""
    loop = Loop(node)
    attached = wait_attached(link, stopping, node.get_logger().warning)
    while attached is not None:
        _spin(loop, Monitor(node, link, board, names, attached), stopping)
        attached = wait_attached(link, stopping, node.get_logger().warning)


def _spin(loop: Loop, monitor: Monitor, stopping: threading.Event) -> None:
    """Return when `stopping` is set, or the server wants other streams."""
    try:
        while not stopping.is_set() and not monitor.outdated:
            loop.turn()  # the monitor's timers end it in time
    except ExternalShutdownException:
        stopping.set()
    finally:  # whatever it ends by, what waits here is answered and not passed
        monitor.stop()
