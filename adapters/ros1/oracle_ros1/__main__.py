"""`python3 -m oracle_ros1`: attach this machine's ROS 1 graph to an oracle server.

Options but --remap can also be private parameters of the node: ~oracle, ~spec, ~session, ~monitor, ~namespace, ~token,
~log, ~streams, ~embedded, ~data.
"""

from __future__ import annotations

import argparse
import json
import re
import signal
import sys
import threading
import time
from typing import TYPE_CHECKING, Any, List, Optional, Sequence, Tuple

import rospy
from oracle_adapter import Board, LinkError, Names, open_log
from oracle_adapter.command import close, default, make_link, parser, wait_attached

from oracle_ros1.codec import CodecError
from oracle_ros1.graph import dump_graph
from oracle_ros1.monitor import CLOCK_PERIOD, Monitor
from oracle_ros1.screen import Screen

if TYPE_CHECKING:
    from oracle_adapter import Link


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run until SIGINT or SIGTERM; 0 after a clean stop, 2 where it can't start or the server refused."""
    own, for_ros = _split(sys.argv if arguments is None else arguments)
    options = _parse(own[1:])
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: sys.exit(0))  # there may be no master yet, and there is nothing to end
    name = re.sub(r"\W", "_", (options.monitor or "monitor").strip("/")) or "monitor"
    rospy.init_node(name, argv=for_ros, disable_signals=True)  # waits for the master
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    rospy.on_shutdown(stopping.set)  # `rosnode kill`, or another node of this name
    try:
        if options.dump_graph:
            sys.stdout.write(json.dumps(dump_graph(), indent=2) + "\n")
            return 0
        return _run(_completed(options), stopping)
    except (CodecError, LinkError, ValueError) as error:
        rospy.logfatal(str(error))
        return 2
    finally:
        rospy.signal_shutdown("the monitor has ended")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    options = parser("oracle_ros1", __doc__)
    options.add_argument("--dump-graph", action="store_true", help="print the live graph as JSON, and end")
    return options.parse_args(arguments)


def _split(arguments: Sequence[str]) -> Tuple[List[str], List[str]]:
    """The adapter's own arguments, and ROS's: its remaps are `a:=b` too, but none follows `--remap`."""
    own: List[str] = []
    for_ros: List[str] = []
    for before, word in zip(["", *arguments], arguments):
        is_ros = ":=" in word and before != "--remap" and not word.startswith("--remap=")
        (for_ros if is_ros else own).append(word)
    return own, for_ros


def _completed(options: argparse.Namespace) -> argparse.Namespace:
    """Take what the command line does not give from a private parameter, or by default."""
    for name, value in vars(options).items():
        if value is None:
            found = rospy.get_param(f"~{name}", "")
            setattr(options, name, str(found) if found != "" else default(name))
    return options


def _run(options: argparse.Namespace, stopping: threading.Event) -> int:
    names = Names(options.remap, options.namespace or "")
    board = Board(options.monitor, Screen(options.monitor))
    failed: List[LinkError] = []

    def on_error(error: LinkError) -> None:
        (rospy.logfatal if error.fatal else rospy.logerr)(f"oracle: {error}")
        if error.fatal:
            failed.append(error)
            stopping.set()

    simulated = bool(rospy.get_param("/use_sim_time", False))
    if options.log and not options.embedded:
        link: Any = open_log(options.log, options.streams, options.monitor, board.on_state, on_error)
    else:
        link = make_link(
            options, clock="sim" if simulated else "wall", on_error=on_error, on_state=board.on_state,
            on_violation=board.on_violation, on_verdicts=board.on_verdicts,
            on_revision=board.on_revision, on_episode=board.on_episode, features=("actions",),
        )  # fmt: skip
    link.start()
    try:
        _observe(link, board, names, stopping, simulated=simulated)
    finally:
        close(link, rospy.logerr)
    return 2 if failed else 0


def _observe(link: Link, board: Board, names: Names, stopping: threading.Event, *, simulated: bool) -> None:
    """Observe what the server names until `stopping` is set. Raises `CodecError`, or ValueError for a bad remap."""
    attached = wait_attached(link, stopping, rospy.logwarn)
    while attached is not None:
        monitor = Monitor(link, board, names, attached, simulated=simulated)
        while not stopping.is_set() and not monitor.outdated:
            monitor.turn()
            time.sleep(CLOCK_PERIOD)  # not `stopping.wait`: a signal that comes inside it would wait for its lock
        monitor.stop()
        if stopping.is_set():
            return
        attached = wait_attached(link, stopping, rospy.logwarn)


if __name__ == "__main__":
    sys.exit(main())
