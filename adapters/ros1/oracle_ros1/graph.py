"""Who publishes what, as the master tells."""

from __future__ import annotations

import threading
from typing import Dict, List

import rospy

PERIOD = 1.0
"""Seconds between two questions."""


class Graph:
    """Asks in a thread of its own, from `start` to `stop`: a master can be far away, and nothing must wait for it."""

    def __init__(self) -> None:
        self._publishers: Dict[str, List[str]] = {}
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._ask, name="oracle-graph", daemon=True)

    def start(self) -> None:
        """Begin to ask."""
        self._thread.start()

    def stop(self) -> None:
        """Ask no more."""
        self._stopping.set()

    def others(self, topic: str) -> List[str]:
        """The nodes but this one that published a topic when the master was last asked."""
        return sorted(set(self._publishers.get(topic, ())) - {rospy.get_name()})

    def _ask(self) -> None:
        master = rospy.get_master()
        while not self._stopping.wait(PERIOD):
            try:
                _, _, (publishers, _, _) = master.getSystemState()
            except (OSError, ValueError, TypeError):  # no master, or none that makes sense
                continue
            self._publishers = {str(topic): list(nodes) for topic, nodes in publishers}
