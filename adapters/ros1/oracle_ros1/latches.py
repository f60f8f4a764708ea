"""What late subscribers of a forwarded topic get: the last message that passed of each publisher that latches.

rospy latches a topic as a whole, and for good: it would keep what publishers said that do not latch, or have gone.
"""

from __future__ import annotations

import threading
from typing import Callable, Dict, Iterable, List

import rospy

from oracle_ros1.headers import Header, header_of


class Latches(rospy.SubscribeListener):  # type: ignore[misc] # rospy has no types
    """Gives each new subscriber what is kept, as the publishers themselves would."""

    def __init__(self, publishers: Callable[[], List[Header]]) -> None:
        """`publishers` returns the connection headers of those that are there."""
        self.lock = threading.RLock()
        """To be held while a message is published: who subscribes meanwhile gets what is kept behind it."""
        self._publishers = publishers
        self._kept: Dict[int, rospy.AnyMsg] = {}  # by the header's id: that of one connection

    def passed(self, message: rospy.AnyMsg) -> None:
        """Keep a message that has passed, where its publisher latches."""
        header = header_of(message)
        if header.get("latching") == "1":
            self._kept.pop(id(header), None)  # the newest comes last
            self._kept[id(header)] = message

    def forget(self) -> None:
        """Keep nothing of publishers that have gone."""
        with self.lock:
            there = {id(header) for header in self._publishers()}
            self._kept = {key: message for key, message in self._kept.items() if key in there}

    def peer_subscribe(self, _name: str, _publish: object, peer_publish: Callable[[rospy.AnyMsg], object]) -> None:
        """Give a new subscriber what is kept."""
        with self.lock:
            self.forget()
            for message in self._kept.values():
                peer_publish(message)


def latching(publishers: Iterable[Header]) -> str:
    """What to tell subscribers: "1" where all that publish latch, as subscribers keep the last message then."""
    found = [header.get("latching") == "1" for header in publishers]
    return "1" if found and all(found) else "0"
