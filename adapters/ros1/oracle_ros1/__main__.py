"""`python3 -m oracle_ros1`: attach this machine's ROS 1 graph to an oracle server.

Each option can also be a private parameter of the node: ~oracle, ~spec, ~session, ~monitor, ~token.
"""

from __future__ import annotations

import argparse
import re
import signal
import sys
import threading
from typing import List, Optional, Sequence

import rospy
from oracle_adapter import Attached, Link, LinkError
from oracle_adapter.command import default, parser, violation_text, wait_attached

from oracle_ros1.codec import CodecError
from oracle_ros1.monitor import CLOCK_PERIOD, Monitor
from oracle_ros1.stamps import simulated_now, wall_now


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run until SIGINT or SIGTERM; 0 after a clean stop, 2 where it can't start or the server refused."""
    argv = list(sys.argv if arguments is None else arguments)
    options = parser("oracle_ros1", __doc__).parse_args(rospy.myargv(argv)[1:])
    name = re.sub(r"\W", "_", (options.monitor or "monitor").strip("/")) or "monitor"
    rospy.init_node(name, argv=argv, disable_signals=True)  # waits for the master
    _complete(options)
    stopping = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopping.set())
    rospy.on_shutdown(stopping.set)  # `rosnode kill`, or another node of this name
    try:
        return _run(options, stopping)
    finally:
        rospy.signal_shutdown("the monitor has ended")


def _complete(options: argparse.Namespace) -> None:
    """What the command line does not say is a private parameter, or the default."""
    for name, value in vars(options).items():
        if value is None:
            found = rospy.get_param(f"~{name}", "")
            setattr(options, name, str(found) if found != "" else default(name))


def _run(options: argparse.Namespace, stopping: threading.Event) -> int:
    failed: List[LinkError] = []

    def on_error(error: LinkError) -> None:
        (rospy.logfatal if error.fatal else rospy.logerr)(f"oracle: {error}")
        if error.fatal:
            failed.append(error)
            stopping.set()

    simulated = bool(rospy.get_param("/use_sim_time", False))
    try:
        link = Link(
            options.oracle, options.monitor, spec=options.spec, session=options.session, token=options.token,
            clock="sim" if simulated else "wall", on_error=on_error,
            on_state=lambda state, detail: rospy.loginfo(f"oracle: {state} {detail}"),
            on_violation=lambda record: rospy.logerr(violation_text(record)),
        )  # fmt: skip
    except ValueError as error:
        rospy.logfatal(str(error))
        return 2
    link.start()
    attached = wait_attached(link, stopping, rospy.logwarn)
    status = 0 if attached is None else _observe(link, attached, stopping, simulated=simulated)
    link.close()
    return 2 if failed else status


def _observe(link: Link, attached: Attached, stopping: threading.Event, *, simulated: bool) -> int:
    try:
        monitor = Monitor(link, attached.streams, simulated_now if simulated else wall_now)
    except CodecError as error:
        rospy.logfatal(str(error))
        return 2
    rospy.loginfo(f"observing {len(attached.streams)} streams for session {attached.session}")
    while not stopping.wait(CLOCK_PERIOD):
        monitor.turn()
    monitor.stop()
    return 0


if __name__ == "__main__":
    sys.exit(main())
