"""What a node of a test does with actions: it serves them as a test says, and sends goals, with real actionlib."""

from __future__ import annotations

import threading
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple
from xmlrpc.client import ServerProxy

import actionlib
import rospy

Behaviour = Callable[[Any, threading.Event], None]
"""What a server does with a goal's handle, in a thread of the goal's own; the event is set by a cancel."""


class Ended(NamedTuple):
    """What came of a goal."""

    status: int
    text: str
    result: Any
    feedback: list[int]


class _Sent:
    """A goal that a client has sent."""

    def __init__(self) -> None:
        self.handle: Any = None
        self.feedback: list[int] = []
        self.states: list[int] = []
        self.ended: Ended | None = None

    def changed(self, handle: Any) -> None:
        state = handle.get_comm_state()
        self.states.append(state)
        if state == actionlib.CommState.DONE:
            result = handle.get_result()
            status, text = handle.get_terminal_state(), handle.get_goal_status_text()
            self.ended = Ended(status, text, result and result.result, self.feedback)


class ActionSide:
    """A part of a node: each method can be called from the test's process, with what can be pickled."""

    def __init__(self) -> None:
        self._servers: dict[str, Any] = {}
        self._cancels: dict[str, threading.Event] = defaultdict(threading.Event)
        self._goals: dict[str, list[str]] = defaultdict(list)
        self._clients: dict[str, Any] = {}
        self._sent: dict[int, _Sent] = {}

    def serve_action(self, name: str, kind: Any, behave: Behaviour) -> None:
        def take(handle: Any) -> None:
            goal_id = handle.get_goal_id().id
            self._goals[name].append(goal_id)
            threading.Thread(target=behave, args=(handle, self._cancels[goal_id]), daemon=True).start()

        def cancel(handle: Any) -> None:
            self._cancels[handle.get_goal_id().id].set()

        self._servers[name] = actionlib.ActionServer(name, kind, take, cancel, auto_start=False)
        self._servers[name].start()

    def goals(self, name: str) -> list[str]:
        """The ids of the goals that have reached a server."""
        return list(self._goals[name])

    def connect(self, name: str, kind: Any) -> None:
        """Be a client of an action."""
        self._clients[name] = actionlib.ActionClient(name, kind)

    def connected(self, name: str) -> bool:
        """Whether its goals reach a server, and it hears all that this says."""
        found = self._clients[name]
        return bool(found.wait_for_server(rospy.Duration(0.2))) and all(
            any(reaches(connection.endpoint_id, topic.resolved_name) for connection in topic.impl.connections)
            for topic in (found.status_sub, found.result_sub, found.feedback_sub)
        )

    def send_goal(self, name: str, number: int, goal: Any) -> str:
        """Send a goal that is called by a number from now on; tells its id."""
        sent = self._sent[number] = _Sent()
        sent.handle = self._clients[name].send_goal(
            goal, sent.changed, lambda _, feedback: sent.feedback.append(feedback.feedback)
        )
        return str(sent.handle.comm_state_machine.action_goal.goal_id.id)

    def cancel_goal(self, number: int) -> None:
        self._sent[number].handle.cancel()

    def cancel_all(self, name: str) -> None:
        self._clients[name].cancel_all_goals()

    def feedback(self, number: int) -> int:
        """How much feedback has come for a goal."""
        return len(self._sent[number].feedback)

    def states(self, number: int) -> list[int]:
        """The states that a goal has gone through, as its client sees it."""
        return list(self._sent[number].states)

    def ended(self, number: int) -> Ended | None:
        """What came of a goal; None while that is open."""
        return self._sent[number].ended


def reaches(uri: str, topic: str) -> bool:
    """Whether a node publishes a topic to this one, as it says itself: here a connection counts before it is made."""
    own = rospy.get_name()
    with suppress(OSError), ServerProxy(uri) as node:
        return any([where, way, what] == [own, "o", topic] for _, where, way, _, what, *_ in node.getBusInfo(own)[2])
    return False  # it has gone
