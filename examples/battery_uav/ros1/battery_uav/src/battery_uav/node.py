"""What the three nodes share: how they start, how they are told to go wrong, how they end."""

import signal
import threading
from typing import Any, Callable, List, Sequence

import rospy
from std_msgs.msg import Header

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


def header() -> Header:
    """A header stamped with the present time."""
    return Header(stamp=rospy.Time.now())


def fault() -> str:
    """The parameter ~fault; it may be another node's."""
    return known_fault(str(rospy.get_param("~fault", "none")))


def wait_heard(publishers: Sequence[rospy.Publisher], default: int, ready: Callable[[], bool] = lambda: True) -> None:
    """Wait until each topic has as many subscriptions as ~wait_for names, and something else is ready too.

    What is published before a subscription is there is lost to it, and a monitor that misses a cause takes its effect
    for a fault.
    """
    wanted = int(rospy.get_param("~wait_for", default))
    topics = " and ".join(publisher.resolved_name for publisher in publishers)
    rospy.loginfo(f"waiting for {wanted} subscriptions to {topics}")
    while not (ready() and all(publisher.get_num_connections() >= wanted for publisher in publishers)):
        rospy.rostime.wallsleep(0.02)
        if rospy.is_shutdown():
            raise rospy.ROSInterruptException
    rospy.loginfo("ready")
