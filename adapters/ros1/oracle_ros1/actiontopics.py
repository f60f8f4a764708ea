"""The five topics of a proxied action, on both sides: what comes, what is given, and whether its server is there."""

from __future__ import annotations

import threading
from typing import Any, List, Mapping

import rospy

from oracle_ros1.actionmessages import ActionTypes
from oracle_ros1.actions import Take, connected, subscribed
from oracle_ros1.codec import CodecError
from oracle_ros1.headers import Header, header_of, headers
from oracle_ros1.observed import deafen
from oracle_ros1.slow import DEPTH

TO_SERVER = ("goal", "cancel")
TO_CLIENT = ("feedback", "result", "status")


class ActionTopics:
    """Publishes to the server and to clients, from any thread; nothing comes before `hear`."""

    def __init__(self, types: ActionTypes, served: str, proxy: str) -> None:
        self.lock = threading.RLock()
        """Held where several things must go together: decisions come in the link's thread."""
        self.stopped = False
        """Whether nothing is given any more."""
        self._types, self._served, self._proxy = types, served, proxy
        self.given = {kind: f"{served if kind in TO_SERVER else proxy}/{kind}" for kind in (*TO_SERVER, *TO_CLIENT)}
        """The names of the topics that are published here."""
        self._publishers = {
            kind: rospy.Publisher(topic, types.topics[kind], latch=kind == "status", tcp_nodelay=True, queue_size=DEPTH)
            for kind, topic in self.given.items()
        }
        self.subscribers: Mapping[str, rospy.Subscriber] = {}

    def hear(self, take: Mapping[str, Take]) -> None:
        """Have what comes taken, kind by kind."""
        with self.lock:  # what comes meanwhile needs all of them
            self.subscribers = subscribed(take, lambda kind: self._proxy if kind in TO_SERVER else self._served)

    def publish(self, kind: str, message: Any) -> bool:
        """Give a message; False where nothing is given any more."""
        with self.lock:
            if self.stopped:
                return False
            try:
                self._publishers[kind].publish(message)
            except rospy.ROSException:  # ROS is shut down, as by `rosnode kill`
                return False
            return True

    def pass_on(self, kind: str, message: rospy.AnyMsg) -> bool:
        """Give what came, byte for byte; False where it is of another type, which `look` tells."""
        try:
            self._types.check(kind, header_of(message))
        except CodecError:
            return False
        return self.publish(kind, message)

    @property
    def server_is_there(self) -> bool:
        """Whether one node is heard, and hears what is passed on."""
        heard = (self.subscribers[kind] for kind in TO_CLIENT)
        return connected(heard, [self._publishers[kind] for kind in TO_SERVER])

    @property
    def servers(self) -> List[Header]:
        """The connections of the server's status."""
        return headers(self.subscribers["status"])

    def forget_status(self) -> None:
        """Let late clients hear nothing of a server that has gone."""
        topic = self._publishers["status"].impl
        if topic is not None:
            topic.latch = None

    def hear_no_more(self) -> None:
        """Take nothing more."""
        for subscriber in self.subscribers.values():
            deafen(subscriber)

    def leave(self) -> None:
        """Unregister at the master."""
        for topic in (*self.subscribers.values(), *self._publishers.values()):
            topic.unregister()
