"""Publishers, and subscribers, that the master knows and that are not connected, as where an address is not known."""

from __future__ import annotations

from typing import Dict, Iterable, Iterator, List, Optional, Tuple

import rospy

from oracle_ros1.graph import Graph
from oracle_ros1.headers import headers

ANSWERS = 5
"""Of the master, one a second, in which a publisher may be missing: one that has just come is connected to soon."""


class Unheard:
    """Those of some subscribers' topics: what they say is judged by nobody."""

    def __init__(self, graph: Graph) -> None:
        self._graph, self._answers = graph, 0
        self._missed: Dict[Tuple[str, str], int] = {}  # in how many answers, by topic and node

    def look(self, subscribers: Iterable[rospy.Subscriber]) -> List[str]:
        """Compare what the master says with who is connected, and return who is not, each in a text."""
        if self._graph.answers != self._answers:  # nodes may have ended since the last one
            self._answers = self._graph.answers
            missing = [found for subscriber in subscribers for found in self._missing(subscriber)]
            self._missed = {found: self._missed.get(found, 0) + 1 for found in missing}
            for (topic, _), count in self._missed.items():
                if _is_due(count):
                    self._graph.connect_again(topic)
        return [self._text(*found) for found, count in self._missed.items() if count >= ANSWERS]

    def _missing(self, subscriber: rospy.Subscriber) -> Iterator[Tuple[str, str]]:
        connected = {header.get("callerid") for header in headers(subscriber)}
        if None in connected:  # one that does not say its name may be any of them
            return
        topic = str(subscriber.resolved_name)
        for node in self._graph.publishers(topic):
            if node not in connected:
                self._graph.address(node)  # is asked for by the time that it is told
                yield topic, node

    def _text(self, topic: str, node: str) -> str:
        address = self._graph.address(node)
        at = f" at {address}" if address else ""
        return (
            f"{node} publishes {topic}, and nothing of it is heard: it can't be reached from here{at}, as where its "
            "ROS_HOSTNAME or ROS_IP is wrong, or this node's own, or it has died"
        )


class Ungiven:
    """Those of a topic that is published here: what passes does not reach them."""

    def __init__(self, graph: Graph) -> None:
        self._graph, self._answers = graph, 0
        self._missed: Dict[str, int] = {}  # in how many answers, by node

    def look(self, publisher: Optional[rospy.Publisher]) -> str:
        """Compare what the master says with who is connected; who is not, empty for nobody."""
        topic = publisher.impl if publisher is not None else None
        if topic is None:
            return ""
        name = str(topic.resolved_name)
        if self._graph.answers != self._answers:
            self._answers = self._graph.answers
            left = [node for node in self._graph.subscribers(name) if not topic.has_connection(node)]
            self._missed = {node: self._missed.get(node, 0) + 1 for node in left}
        why = "it asks for another type or definition, or for UDP, can't reach this node, or has died"
        return "; ".join(
            f"{node} subscribes to {name}, and gets nothing of it: {why}"
            for node, count in self._missed.items()
            if count >= ANSWERS
        )


def _is_due(count: int) -> bool:
    """Whether to try again: less and less often, as rospy goes on with each try at a machine that was switched off."""
    tries, rest = divmod(count, ANSWERS)
    return rest == 0 and tries & (tries - 1) == 0
