"""Where the board shows: the log, two topics of the monitor, and `/diagnostics`."""

from __future__ import annotations

from contextlib import suppress
from typing import Any, Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from oracle_adapter import Status, graph_name
from oracle_adapter.monitors import ERRORS, VERDICT
from std_msgs.msg import String


class Screen:
    """One monitor's publishers; every method may be called in any thread."""

    def __init__(self, monitor: str) -> None:
        """Publish nothing yet."""
        own = graph_name(monitor)
        self._monitor = monitor
        self._verdict = rospy.Publisher(f"{own}/{VERDICT}", String, latch=True, queue_size=10)
        self._error = rospy.Publisher(f"{own}/{ERRORS}", String, queue_size=100)
        self._diagnostics = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)

    def verdict(self, outcome: str) -> None:
        """Publish the worst outcome over the properties."""
        _publish(self._verdict, outcome)

    def error(self, text: str) -> None:
        """Log an error, and publish it."""
        rospy.logerr(text)
        _publish(self._error, text)

    def info(self, text: str) -> None:
        """Log a text."""
        rospy.loginfo(text)

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Publish the statuses."""
        array = DiagnosticArray(status=[self._status(status) for status in statuses])
        array.header.stamp = rospy.Time.now()
        _publish(self._diagnostics, array)

    def _status(self, status: Status) -> DiagnosticStatus:
        values = [KeyValue(key, value) for key, value in status.values]
        return DiagnosticStatus(status.level, status.name, status.message, self._monitor, values)


def _publish(publisher: rospy.Publisher, message: Any) -> None:
    with suppress(rospy.ROSException):  # ROS is shut down, as by `rosnode kill`: there are no subscribers
        publisher.publish(message)
