"""Actions whose five topics pass through a proxy.

What is not asked about passes at once, byte for byte. What is asked about waits for the decision; what must not pass is
answered as a server would, so that no client waits for ever.
"""

from __future__ import annotations

import threading
import time
from typing import Any, Callable, Dict, Mapping, Optional

import rospy
from actionlib_msgs.msg import GoalStatus
from oracle_adapter.behind import Behind
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.interfaces import Interface

from oracle_ros1.actionevents import ActionEvents, Event
from oracle_ros1.actiongoals import Goals
from oracle_ros1.actionmessages import Goal, Said, with_id
from oracle_ros1.actionshown import ShownStatuses
from oracle_ros1.actionstatus import status
from oracle_ros1.actiontopics import ActionTopics
from oracle_ros1.codec import write
from oracle_ros1.definitions import lookup_installed
from oracle_ros1.shared import Shared
from oracle_ros1.unserved import UnservedAction

UNDERWAY = 0.2
"""Seconds that an answer may take to its client."""


class ProxiedAction:
    """Serves an action under the proxy's name, and is a client of its server."""

    def __init__(self, shared: Shared, action: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        first = next(iter(action.streams.values()))
        self._graph = shared.graph
        self._events = ActionEvents(shared, action, proxied=True)
        self.streams = list(self._events.streams.values())
        self.bypass = ""
        """Who publishes past the monitor what it gives."""
        self.doubt = ""
        """That nobody has served it so far, as of the last look."""
        served, proxy = shared.names[action.name], shared.names[first["proxy"]]
        self._unserved = UnservedAction(shared.graph, served, proxy)
        self._types = self._events.types
        self._denied: Mapping[str, Any] = first.get("denied_result") or {}
        write(self._types.inner["result"](), self._denied, lookup_installed)
        self._answering = False  # whether goals were rejected as it ended
        self._behind = Behind()  # results come behind feedback that is decided on
        self._reporting = threading.Lock()  # held while something that has passed is not reported yet
        self._topics = ActionTopics(self._types, served, proxy)
        self._shown = ShownStatuses(self._topics, self._events)
        asked = {stream.kind: stream.passing for stream in self.streams if stream.passing is not None}
        self._goals = Goals(self._events, self._topics, self._shown, shared.board.error, asks_results="result" in asked)
        give: Dict[str, Callable[[Any], bool]] = {
            "goal": self._goals.give,
            "cancel": self._goals.cancel,
            "feedback": self._give_feedback,
            "result": self._give_result,
        }
        withheld: Dict[str, Callable[[Any, str], None]] = {
            "goal": self._goals.deny,
            "feedback": lambda said, _: self._settle(said),
            "result": self._deny_result,
        }
        self._give = give
        before = {"goal": Goal.may_be_taken_back}
        self._queues = {
            kind: ForwardQueue(passing, give[kind], withheld.get(kind), before.get(kind))
            for kind, passing in asked.items()
        }
        self._topics.hear(
            {
                "goal": self._take_goal,
                "cancel": self._take_cancel,
                "feedback": self._take_feedback,
                "result": self._take_result,
                "status": self._shown.take,
            }
        )

    def look(self) -> str:
        """What is wrong; goals that wait for the server, and results that wait for feedback, go on."""
        self._goals.look()
        self._behind.catch_up()
        self.doubt = self._unserved.look()
        past = [text for topic in self._topics.given.values() for text in self._graph.past(topic)]
        self.bypass = "; ".join(past)
        troubles = [*self._events.troubles(self._topics.subscribers), *past, self._goals.trouble]
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Serve no more: goals that the server has not got are rejected, the others go on there."""
        self._topics.hear_no_more()
        self._behind.release()
        self._answering = self._goals.stop()

    def leave(self) -> None:
        """Unregister at the master."""
        if self._answering:
            time.sleep(UNDERWAY)  # answers that have not arrived yet go with their topic
        self._topics.leave()

    # From clients

    def _take_goal(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("goal", message)
        if found is None:
            return
        number = next(self._events.numbers)
        if not found.goal_id.id:
            message = with_id(found, message, f"{rospy.get_name()}-{number}")
        goal = Goal(number, found.goal_id, message)
        if not self._goals.begin(goal):
            return
        self._catch_up()
        event = self._events.event("goal", found, found.goal, found.goal_id.id, call=goal.number)
        self._pass_on("goal", goal, event)

    def _take_cancel(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("cancel", message)
        if found is None:
            return
        said = Said(next(self._events.numbers), message, found)
        self._catch_up()
        self._pass_on("cancel", said, self._events.event("cancel", found, found, found.id, call=said.number))

    # From the server

    def _take_feedback(self, message: rospy.AnyMsg) -> None:
        if "feedback" not in self._queues:
            self._pass_and_report("feedback", message)
            return
        found = self._events.decoded("feedback", message)
        if found is None:
            return
        goal_id = found.status.goal_id.id
        self._events.answered(goal_id, found.status.status, found.header)
        event = self._events.event("feedback", found, found.feedback, goal_id)
        self._pass_on("feedback", Said(self._behind.came(goal_id), message, found), event)

    def _give_feedback(self, said: Said) -> bool:
        passed = self._topics.publish("feedback", said.message)
        self._settle(said)
        return passed

    def _settle(self, said: Said) -> None:
        """Feedback was passed on, or not: a result may go on behind it."""
        self._behind.settle(said.found.status.goal_id.id, said.number)

    def _take_result(self, message: rospy.AnyMsg) -> None:
        if not {"feedback", "result"} & self._queues.keys():
            found = self._pass_and_report("result", message)
            if found is not None:
                self._goals.over(found.status.goal_id.id)
            return
        found = self._events.decoded("result", message)
        if found is None:
            return
        said = found.status
        self._events.answered(said.goal_id.id, said.status, found.header)
        if "result" in self._queues:
            self._shown.deciding(said.goal_id.id)
        event = self._events.event("result", found, found.result, said.goal_id.id, code=said.status)
        self._pass_on("result", Said(0, message, found), event)

    def _give_result(self, said: Said) -> bool:
        goal_id = said.found.status.goal_id.id

        def give() -> None:
            self._topics.publish("result", said.message)
            self._goals.over(goal_id)

        if self._topics.stopped:
            return False
        self._behind.after(goal_id, give)
        return True

    def _deny_result(self, said: Said, reason: str) -> None:
        goal = said.found.status.goal_id
        denied = write(self._types.inner["result"](), self._denied, lookup_installed)
        own = status(goal, GoalStatus.ABORTED, f"denied: {reason}")
        self._behind.after(goal.id, lambda: self._goals.end(own, denied))

    # All kinds

    def _catch_up(self) -> None:
        """Wait until all that has passed is reported: what a client does then comes behind what it has heard."""
        for busy in (self._reporting, self._topics.lock):
            with busy:
                pass

    def _pass_on(self, kind: str, what: Any, event: Optional[Event]) -> None:
        queue = self._queues.get(kind)
        if queue is not None and event is not None:
            queue.take(what, event.stamp, event.data, **event.more)
            return
        if event is not None:  # before it can have consequences
            self._events.send(kind, event)
        self._give[kind](what)

    def _pass_and_report(self, kind: str, message: rospy.AnyMsg) -> Any:
        """Pass on what nobody is asked about, and then read and report it; None where it is not read."""
        with self._reporting:
            if not self._topics.pass_on(kind, message):
                return None
            time.sleep(0)  # rospy writes in a thread, which would wait until all this is done
            if kind == "feedback" and not self._events.reads(kind):
                return None
            found = self._events.decoded(kind, message)
            self._events.answer(kind, found)
            return found
