"""What nodes publish that a restarted master does not know any more: none of them tells it again."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, Callable, Dict, Optional, Set
from xmlrpc.client import Fault, ServerProxy

import rospy

from oracle_ros1.timed import TimedTransport

NODE_WITHIN = 1.0
"""Seconds that a node may take to answer."""
GONE_AFTER = 60.0
"""Seconds after which a node counts as gone that can't be reached, as where its machine was switched off."""
ASK_PERIOD = 10.0
"""Seconds between two questions to such a node: it may be there again."""


@dataclass
class _Node:
    address: str
    topics: Set[str]
    heard: float
    asked: float


class Forgotten:
    """The nodes that are asked themselves."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        """`clock`: seconds."""
        self._clock = clock
        self._nodes: Dict[str, _Node] = {}

    def __contains__(self, node: str) -> bool:
        return node in self._nodes

    def add(self, node: str, address: str, topics: Set[str]) -> None:
        """Ask from now on which of some topics a node publishes; nothing where it is asked already."""
        self._nodes.setdefault(node, _Node(address, topics, self._clock(), -ASK_PERIOD))

    def look(self) -> Dict[str, Set[str]]:
        """Ask them; the topics of those that are there, by node."""
        for name, node in list(self._nodes.items()):
            now = self._clock()
            if now - node.heard > GONE_AFTER and now - node.asked < ASK_PERIOD:
                continue
            node.asked, found = now, _published(node.address, node.topics)
            if found is not None:
                node.heard, node.topics = now, found
            if not node.topics:
                del self._nodes[name]
        now = self._clock()
        return {name: node.topics for name, node in self._nodes.items() if now - node.heard <= GONE_AFTER}


def _published(address: str, topics: Set[str]) -> Optional[Set[str]]:
    """Which of some topics the node at an address publishes, all where it does not say; None where it can't be reached.

    None at all where no node is there any more.
    """
    try:
        node: Any = ServerProxy(address, transport=TimedTransport(NODE_WITHIN))
        code, _, found = node.getPublications(rospy.get_name())
        return topics & {topic for topic, _ in found} if code == 1 else topics
    except (Fault, TypeError, ValueError):
        return topics
    except ConnectionError:
        return set()
    except OSError:
        return None
    except Exception:  # noqa: BLE001 - another program is there
        return set()
