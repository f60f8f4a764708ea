"""Actions that are only observed: on ROS 1 their five topics are as any others."""

from __future__ import annotations

from functools import partial
from typing import Callable, Dict, Iterable, List, Mapping, Optional

import rospy
from oracle_adapter.interfaces import Interface

from oracle_ros1.actionevents import ActionEvents, Event
from oracle_ros1.actionstatus import Statuses
from oracle_ros1.headers import header_of, headers, node_of
from oracle_ros1.observed import deafen
from oracle_ros1.shared import Shared
from oracle_ros1.unserved import UnservedAction

_NAMELESS = (
    "their server gives them one that nobody else knows, so that their replies, feedback, results and statuses are "
    "those of other goals here; by a proxy they would have one"
)
Take = Callable[[rospy.AnyMsg], None]


def subscribed(take: Mapping[str, Take], name: Callable[[str], str]) -> Dict[str, rospy.Subscriber]:
    """Subscribers of an action's topics by their kinds; `name` is the action's on the side of a kind."""
    return {
        kind: rospy.Subscriber(f"{name(kind)}/{kind}", rospy.AnyMsg, call, tcp_nodelay=True)
        for kind, call in take.items()
    }


def connected(heard: Iterable[rospy.Subscriber], hearing: List[rospy.Publisher]) -> bool:
    """Whether one node is heard by all these subscribers, and hears all these publishers."""
    nodes = set.intersection(*({header.get("callerid") for header in headers(topic)} for topic in heard))
    return any(all(topic.impl and topic.impl.has_connection(node) for topic in hearing) for node in nodes)


class LoggedAction:
    """Reports what passes between an action's clients and its server."""

    bypass = ""

    def __init__(self, shared: Shared, action: Interface) -> None:
        """Observe at once. Raises `CodecError`."""
        self._unserved = UnservedAction(shared.graph, shared.names[action.name])
        self._events, self._statuses = ActionEvents(shared, action, proxied=False), Statuses()
        self.streams = list(self._events.streams.values())
        self.doubt = ""
        """That nobody has served it so far, and whose goals have no ids, as of the last look."""
        self._nameless = ""  # the last node that sent a goal without an id
        take: Dict[str, Take] = {
            "goal": self._take_goal,
            "cancel": self._take_cancel,
            "feedback": partial(self._take_answer, "feedback"),
            "result": partial(self._take_answer, "result"),
            "status": self._take_status,
        }
        wanted = {kind: call for kind, call in take.items() if self._events.reads(kind)}
        if "reply" in self._events.streams:
            wanted["goal"] = self._take_goal
        self._subscribers = subscribed(wanted, lambda _: shared.names[action.name])

    def look(self) -> str:
        """What is wrong."""
        self.doubt = "; ".join(filter(None, (self._unserved.look(), self._nameless)))
        return "; ".join(self._events.troubles(self._subscribers))

    def stop(self) -> None:
        """Take no more."""
        for subscriber in self._subscribers.values():
            deafen(subscriber)

    def leave(self) -> None:
        """Unregister at the master."""
        for subscriber in self._subscribers.values():
            subscriber.unregister()

    def _take_goal(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("goal", message)
        if found is not None:
            call, goal_id = next(self._events.numbers), found.goal_id.id
            self._report("goal", self._events.event("goal", found, found.goal, goal_id, call=call))
            if goal_id:
                self._events.expect_reply(goal_id, call)
                self._take_told(goal_id)
            else:
                node = node_of(header_of(message))
                self._nameless = f"{node} sends goals without an id: {_NAMELESS}"

    def _take_told(self, goal_id: str) -> None:
        """Report the reply that came before the goal, on another topic: the server does not say it again."""
        array, code = self._statuses.last, self._statuses.told(goal_id)
        if array is not None and code is not None:
            self._events.answered(goal_id, code, array.header)

    def _take_cancel(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("cancel", message)
        if found is not None:
            call = next(self._events.numbers)
            self._report("cancel", self._events.event("cancel", found, found, found.id, call=call))

    def _take_answer(self, kind: str, message: rospy.AnyMsg) -> None:
        self._events.answer(kind, self._events.decoded(kind, message))

    def _take_status(self, message: rospy.AnyMsg) -> None:
        array = self._events.decoded("status", message)
        if array is not None:
            self._events.changed(array, self._statuses.changes(array, self._events.standing(array)))

    def _report(self, kind: str, event: Optional[Event]) -> None:
        if event is not None:
            self._events.send(kind, event)
