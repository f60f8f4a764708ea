"""Attach this machine's ROS 1 graph to an oracle server: the adapter from its command line to its end.

Options but --remap can also be private parameters of the node: ~oracle, ~spec, ~session, ~monitor, ~namespace, ~token,
~log, ~streams, ~embedded, ~data. What the command line says, also as _spec:=NAME, comes first.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import sys
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Any, Callable, List, Optional, Sequence

import rospy
from oracle_adapter import Board, LinkError, Names, open_log
from oracle_adapter.command import close, make_link, wait_attached

from oracle_ros1.codec import CodecError
from oracle_ros1.console import log_anyway
from oracle_ros1.graph import dump_graph, log_without_master
from oracle_ros1.handshakes import hear_each_by_itself, note_refused_callers, tell_wrong_address
from oracle_ros1.monitor import CLOCK_PERIOD, Monitor
from oracle_ros1.nodename import no_master, taken
from oracle_ros1.options import complete, read_options
from oracle_ros1.screen import Screen
from oracle_ros1.stopping import Stopping

if TYPE_CHECKING:
    from oracle_adapter import Link

LEAVE_WITHIN = 3.0
"""Seconds for which the adapter waits, as it ends, for the master to take a registration back."""
_NEW_NODE = "new node registered with same name"
"""The master's reason to end a node whose name another one has taken."""


def run(arguments: Sequence[str], stopping: Stopping) -> int:
    """Run until `stopping` is set; 0 after a clean stop, 2 where it can't start, is refused, or is replaced."""
    options, for_ros = read_options(arguments, __doc__)
    hear_each_by_itself()
    note_refused_callers()
    with stopping.asking_master():  # there may be none yet, and there is nothing to end
        why = no_master() or ("" if options.dump_graph else taken(_node_name(options), for_ros, _say))
        if why:
            _say(why)
            return 2
        # waits for the master; a node of the name that another one has would end that one
        try:
            rospy.init_node(_node_name(options), argv=for_ros, anonymous=options.dump_graph, disable_signals=True)
        except Exception as error:  # noqa: BLE001 - of many classes, as where its log can't be written
            _say(f"ROS does not start: {type(error).__name__}: {error}")
            return 2
        log_anyway()
        log_without_master()
    return _as_node(options, stopping)


def _as_node(options: argparse.Namespace, stopping: Stopping) -> int:
    """What `run` does once there is a node."""
    replaced: List[str] = []

    def ended(reason: str) -> None:
        if _NEW_NODE in reason:
            replaced.append(reason)
        stopping.set()

    rospy.core.add_preshutdown_hook(ended)  # `rosnode kill`, or another node of this name
    status = 0
    try:
        with suppress(SystemExit):  # a signal came while the master was asked
            status = _do(options, stopping)
    except (CodecError, LinkError, ValueError) as error:
        rospy.logfatal(str(error))
        status = 2
    finally:
        stopping.calm()
        left = _in_time(lambda: rospy.signal_shutdown("the monitor has ended"))
    if replaced:
        rospy.logfatal(f"the monitor has ended: another node was started as {rospy.get_name()}")
        status = 2
    if not left:
        rospy.logwarn("the master does not answer: it may list this node although it has ended")
        sys.stdout.flush()
        os._exit(status)  # rospy would go on to wait for the master
    return status


def _do(options: argparse.Namespace, stopping: Stopping) -> int:
    """What the options ask for; the exit status."""
    with stopping.asking_master():
        if options.dump_graph:
            sys.stdout.write(json.dumps(dump_graph(), indent=2) + "\n")
            return 0
        complete(options, rospy.logwarn, rospy.loginfo)
        tell_wrong_address()
        simulated = bool(rospy.get_param("/use_sim_time", False))
        board = Board(options.monitor, Screen(options.monitor))
    return _run(options, board, stopping, simulated=simulated)


def _say(text: str) -> None:
    """Tell something before there is a node that logs."""
    sys.stderr.write(f"oracle_ros1: {text}\n")


def _in_time(leave: Callable[[], None]) -> bool:
    """Whether something that the master must answer is done within `LEAVE_WITHIN`."""
    leaving = threading.Thread(target=leave, daemon=True)
    leaving.start()
    leaving.join(LEAVE_WITHIN)
    return not leaving.is_alive()


def _node_name(options: argparse.Namespace) -> str:
    """The monitor's name as ROS allows it, which wants a letter at the beginning."""
    name = re.sub(r"\W", "_", (options.monitor or "monitor").strip("/"), flags=re.ASCII) or "monitor"
    return name if name[0].isalpha() else f"monitor_{name}"


def _run(options: argparse.Namespace, board: Board, stopping: Stopping, *, simulated: bool) -> int:
    names = Names(options.remap, options.namespace or "")
    failed: List[LinkError] = []

    def on_error(error: LinkError) -> None:
        (rospy.logfatal if error.fatal else rospy.logerr)(f"oracle: {error}")
        if error.fatal:
            failed.append(error)
            stopping.set()

    if options.log and not options.embedded:
        link: Any = open_log(options.log, options.streams, options.monitor, board.on_state, on_error)
    else:
        link = make_link(
            options, clock="sim" if simulated else "wall", on_error=on_error, on_state=board.on_state,
            on_violation=board.on_violation, on_verdicts=board.on_verdicts,
            on_revision=board.on_revision, on_episode=board.on_episode, features=("actions",),
        )  # fmt: skip
    link.start()
    monitor = None
    try:
        with suppress(SystemExit):  # a signal came, or the link has ended, while the master was asked
            monitor = _observe(link, board, names, stopping, simulated=simulated)
    finally:  # first what waits is settled: the master may hang
        stopping.calm()
        close(link, rospy.logerr)
        if monitor is not None:
            _in_time(monitor.leave)
    return 2 if failed else 0


def _observe(link: Link, board: Board, names: Names, stopping: Stopping, *, simulated: bool) -> Optional[Monitor]:
    """Observe what the server names until `stopping` is set; the monitor that has stopped then.

    Raises `CodecError`, or ValueError for a bad remap.
    """
    attached = wait_attached(link, stopping, rospy.logwarn)
    while attached is not None:
        with stopping.asking_master():
            monitor = Monitor(link, board, names, attached, simulated=simulated)
        while not stopping.is_set() and not monitor.outdated:
            monitor.turn()
            time.sleep(CLOCK_PERIOD)  # not `stopping.wait`: a signal that comes inside it would wait for its lock
        monitor.stop()
        if stopping.is_set():
            return monitor
        with stopping.asking_master():
            monitor.leave()
        attached = wait_attached(link, stopping, rospy.logwarn)
    return None
