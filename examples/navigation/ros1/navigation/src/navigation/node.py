"""What the three nodes share: how they start, how they are told to go wrong, how they end."""

import signal
import threading
from typing import Any, Callable, List

import rospy

from .logic import known_fault

DEPTH = 100  # messages that a topic keeps for a slow subscriber


def run(name: str, work: Callable[[], None]) -> None:
    """Do a node's work until it is done, or SIGINT or SIGTERM tells the node to stop.

    rospy's own handlers shut down in the midst of whatever the node does, and can wait for a lock that it holds itself.
    """
    rospy.init_node(name, disable_signals=True)
    stopping: List[int] = []

    def stop(number: int, _frame: object) -> None:
        stopping.append(number)
        threading.Thread(target=rospy.signal_shutdown, args=[f"signal {number}"]).start()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        work()
    except rospy.ROSException:  # it slept, or was about to publish
        if not stopping and not rospy.is_shutdown():
            raise
    rospy.signal_shutdown("its work is done")


def publisher(topic: str, kind: Any) -> rospy.Publisher:
    """A publisher that never waits for who hears it."""
    return rospy.Publisher(topic, kind, queue_size=DEPTH, tcp_nodelay=True)


def fault() -> str:
    """The parameter ~fault; it may be another node's."""
    return known_fault(str(rospy.get_param("~fault", "none")))


def wait_heard(publisher: rospy.Publisher) -> None:
    """Wait until a topic has as many subscriptions as ~wait_for names.

    What is published before a subscription is there is lost to it, and a monitor that has not heard how the robot
    stands lets no goal pass.
    """
    wanted = int(rospy.get_param("~wait_for", 0))
    rospy.loginfo(f"waiting for {wanted} subscriptions to {publisher.resolved_name}")
    until(lambda: publisher.get_num_connections() >= wanted)
    rospy.loginfo("ready")


def until(condition: Callable[[], object]) -> None:
    """Wait for something."""
    while not condition():
        rospy.rostime.wallsleep(0.02)
        if rospy.is_shutdown():
            raise rospy.ROSInterruptException
