"""Where the board shows: the log, two topics of the monitor, and `/diagnostics`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Sequence

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from oracle_adapter import Status, graph_name, monitors
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

from oracle_ros2.qos import NO_EVENTS

if TYPE_CHECKING:
    from rclpy.node import Node

ERRORS = QoSProfile(depth=100)
LATEST = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Whoever subscribes later still gets the last one."""


class Screen:
    """One monitor's publishers; every method may be called in any thread."""

    def __init__(self, node: Node, monitor: str) -> None:
        """Publish nothing yet."""
        own = graph_name(monitor)
        self._monitor, self._log, self._clock = monitor, node.get_logger(), node.get_clock()
        self._verdict = node.create_publisher(String, f"{own}/{monitors.VERDICT}", LATEST, event_callbacks=NO_EVENTS)
        self._error = node.create_publisher(String, f"{own}/{monitors.ERRORS}", ERRORS, event_callbacks=NO_EVENTS)
        self._diagnostics = node.create_publisher(DiagnosticArray, "/diagnostics", 10, event_callbacks=NO_EVENTS)

    def verdict(self, outcome: str) -> None:
        """Publish the worst outcome over the properties."""
        self._verdict.publish(String(data=outcome))

    def error(self, text: str) -> None:
        """Log an error, and publish it."""
        self._log.error(text)
        self._error.publish(String(data=text))

    def info(self, text: str) -> None:
        """Log a text."""
        self._log.info(text)

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        """Publish the statuses."""
        array = DiagnosticArray(status=[self._status(status) for status in statuses])
        array.header.stamp = self._clock.now().to_msg()
        self._diagnostics.publish(array)

    def _status(self, status: Status) -> DiagnosticStatus:
        values = [KeyValue(key=key, value=value) for key, value in status.values]
        level = bytes([status.level])
        return DiagnosticStatus(
            level=level, name=status.name, message=status.message, hardware_id=self._monitor, values=values
        )
