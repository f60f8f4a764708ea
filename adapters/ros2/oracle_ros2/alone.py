"""Whether anybody else is on the ROS graph: nobody is where the adapter is in another domain than the robot."""

from __future__ import annotations

import os
import time
from typing import TYPE_CHECKING, Callable

from oracle_adapter.unpublished import PATIENCE
from rclpy.utilities import get_rmw_implementation_identifier

if TYPE_CHECKING:
    from rclpy.node import Node

GRAPH = "the ROS graph"
"""What the board calls it."""
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"


class Alone:
    """Whether no other node has been there since this began; the hidden ones of ROS's tools do not count."""

    def __init__(self, node: Node, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock` returns seconds."""
        self._node, self._clock = node, clock
        self._due: float | None = clock() + PATIENCE

    def look(self) -> str:
        """What to tell; empty where somebody has been there, or it is too early."""
        if self._due is None:
            return ""
        own = self._node.get_name(), self._node.get_namespace()
        others = self._node.get_node_names_and_namespaces()
        if any((name, space) != own and not name.startswith("_") for name, space in others):
            self._due = None
            return ""
        if self._clock() < self._due:
            return ""
        reach = os.environ.get(_RANGE) or "not set"
        return (
            "no other node is on the ROS graph: start the adapter with the settings of the robot's nodes; here "
            f"ROS_DOMAIN_ID is {self._node.context.get_domain_id()}, {_RANGE} is {reach}, "
            f"and the middleware {get_rmw_implementation_identifier()}"
        )
