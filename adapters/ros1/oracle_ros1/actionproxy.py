"""Actions whose five topics pass through a proxy.

What is not asked about passes at once, byte for byte. What is asked about waits for the decision; what must not pass is
answered as a server would, so that no client waits for ever.
"""

from __future__ import annotations

import threading
import time
from collections import Counter, OrderedDict
from typing import Any, Callable, Dict, List, Mapping, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.interfaces import Interface

from oracle_ros1.actionevents import KEPT, ActionEvents, Event
from oracle_ros1.actionmessages import Goal, Said, covers
from oracle_ros1.actions import Take, connected, subscribed
from oracle_ros1.actionstatus import Statuses, status
from oracle_ros1.codec import CodecError, write
from oracle_ros1.definitions import lookup_installed
from oracle_ros1.observed import header_of, headers
from oracle_ros1.shared import Shared
from oracle_ros1.topics import DEPTH

TO_SERVER = ("goal", "cancel")
TO_CLIENT = ("feedback", "result", "status")
AWAY = 2.0
"""Seconds that a server may take to be connected, or to come back."""
UNDERWAY = 0.2
"""Seconds that an answer may take to its client."""
BEHIND = 1.0
"""Seconds that a result waits at most for feedback that is decided on."""


class ProxiedAction:
    """Serves an action under the proxy's name, and is a client of its server."""

    def __init__(self, shared: Shared, action: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        first = next(iter(action.streams.values()))
        self._board, self._graph, self._name = shared.board, shared.graph, action.name
        self._events, self._statuses = ActionEvents(shared, action, proxied=True), Statuses()
        self.streams = list(self._events.streams.values())
        self.bypass = ""
        """Who publishes past the monitor what it gives."""
        self._types = self._events.types
        self._denied: Mapping[str, Any] = first.get("denied_result") or {}
        write(self._types.inner["result"](), self._denied, lookup_installed)
        self._lock = threading.RLock()  # guards what follows: decisions come in the link's thread
        self._waiting: "OrderedDict[int, Goal]" = OrderedDict()  # goals that the server has not got
        self._underway: "OrderedDict[str, GoalID]" = OrderedDict()  # goals that it has got, and no result is passed on
        self._feedback: Counter[str] = Counter()  # messages that are decided on, by their goals
        self._behind: List[Said] = []  # results behind these
        self._status: Optional[rospy.AnyMsg] = None  # the server's last
        self._server: List[Any] = []  # the connections of the server's status
        self._told = False  # clients hear of it
        self._gone: Optional[float] = None  # since when there is none (s)
        self._lost_goals = 0
        self._stopped = False
        self._reporting = threading.Lock()  # held while something that has passed is not reported yet
        give: Dict[str, Callable[[Any], bool]] = {
            "goal": self._give_goal,
            "cancel": self._give_cancel,
            "feedback": self._give_feedback,
            "result": self._give_result,
        }
        withheld: Dict[str, Callable[[Any, str], None]] = {
            "goal": self._deny_goal,
            "feedback": lambda said, _: self._decided(said),
            "result": self._deny_result,
        }
        self._give = give
        self._queues = {
            stream.kind: ForwardQueue(stream.passing, give[stream.kind], withheld.get(stream.kind))
            for stream in self.streams
            if stream.passing is not None
        }
        served, proxy = shared.names[action.name], shared.names[first["proxy"]]
        self._topics = {kind: f"{served if kind in TO_SERVER else proxy}/{kind}" for kind in (*TO_SERVER, *TO_CLIENT)}
        self._publishers = {
            kind: rospy.Publisher(
                topic, self._types.topics[kind], latch=kind == "status", tcp_nodelay=True, queue_size=DEPTH
            )
            for kind, topic in self._topics.items()
        }
        take: Dict[str, Take] = {
            "goal": self._take_goal,
            "cancel": self._take_cancel,
            "feedback": self._take_feedback,
            "result": self._take_result,
            "status": self._take_status,
        }
        with self._lock:  # what comes meanwhile needs all of them
            self._subscribers = subscribed(take, lambda kind: proxy if kind in TO_SERVER else served)

    def look(self) -> str:
        """What is wrong; goals that wait for the server, and results that wait for feedback, go on."""
        now = time.monotonic()
        with self._lock:
            self._look_for_server(now)
            if not self._told and self._is_there():
                self._told = True
                self._show()
            self._pass_early(now)
            self._release(now)
        past = [
            f"{node} publishes {topic} past the monitor"
            for topic in self._topics.values()
            for node in self._graph.others(topic)
        ]
        self.bypass = "; ".join(past)
        gone = f"its server has gone; goals answered as aborted: {self._lost_goals}" if self._lost_goals else ""
        return "; ".join([*self._events.troubles(self._subscribers), *past, *([gone] if gone else [])])

    def stop(self) -> None:
        """Serve no more: goals that the server has not got are rejected, the others go on there."""
        for subscriber in self._subscribers.values():
            subscriber.unregister()
        with self._lock:
            left = list(self._waiting.values())
            for goal in left:
                self._answer(goal, GoalStatus.REJECTED, "the monitor ends")
            self._stopped = True
            going = len(self._underway)
        if going:
            self._board.error(f"{self._name}: the monitor ends; goals that go on at the server: {going}")
        if left:
            time.sleep(UNDERWAY)  # answers that have not arrived yet go with their topic
        for publisher in self._publishers.values():
            publisher.unregister()

    # From clients

    def _take_goal(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("goal", message)
        if found is None:
            return
        goal = Goal(next(self._events.numbers), found.goal_id, message)
        with self._lock:
            if self._stopped:
                return
            self._waiting[goal.number] = goal
        self._catch_up()
        event = self._events.event("goal", found, found.goal, found.goal_id.id, call=goal.number)
        self._pass_on("goal", goal, event)

    def _give_goal(self, goal: Goal) -> bool:
        """Let the server have a goal, as soon as it is there."""
        with self._lock:
            if self._stopped or goal.number not in self._waiting:
                return False  # it was cancelled meanwhile
            goal.allowed = time.monotonic()
            early = any(other.allowed for other in self._waiting.values() if other is not goal)
            if early or not self._is_there():
                return True
            return self._send_goal(goal)

    def _send_goal(self, goal: Goal) -> bool:
        del self._waiting[goal.number]
        goal_id = goal.goal_id.id
        self._underway[goal_id] = goal.goal_id
        if len(self._underway) > KEPT:
            self._statuses.settled(self._underway.popitem(last=False)[0])
        if "result" in self._queues:
            self._statuses.open(goal_id)
        self._events.expect_reply(goal_id, goal.number)
        return self._publish("goal", goal.message)

    def _deny_goal(self, goal: Goal, reason: str) -> None:
        with self._lock:
            self._answer(goal, GoalStatus.REJECTED, f"denied: {reason}")

    def _answer(self, goal: Goal, code: int, text: str) -> None:
        """Let a client have the end of a goal that the server has not got, unless it has it."""
        if self._waiting.pop(goal.number, None) is not None:
            self._end(status(goal.goal_id, code, text), self._types.inner["result"]())

    def _take_cancel(self, message: rospy.AnyMsg) -> None:
        found = self._events.decoded("cancel", message)
        if found is None:
            return
        said = Said(next(self._events.numbers), message, found)
        self._catch_up()
        self._pass_on("cancel", said, self._events.event("cancel", found, found, found.id, call=said.number))

    def _give_cancel(self, said: Said) -> bool:
        """Let the server have a cancel; the goals that it has not got, and came before, are over here."""
        with self._lock:
            passed = self._publish("cancel", said.message)
            for goal in list(self._waiting.values()):
                if goal.number < said.number and covers(said.found, goal.goal_id):
                    self._answer(goal, GoalStatus.RECALLED, "cancelled before the server got it")
        return passed

    # From the server

    def _take_feedback(self, message: rospy.AnyMsg) -> None:
        queue = self._queues.get("feedback")
        if queue is None:
            self._pass_and_report("feedback", message)
            return
        found = self._events.decoded("feedback", message)
        if found is None:
            return
        said = found.status
        self._events.answered(said.goal_id.id, said.status, found.header)
        with self._lock:
            self._feedback[said.goal_id.id] += 1
        event = self._events.event("feedback", found, found.feedback, said.goal_id.id)
        self._pass_on("feedback", Said(0, message, found), event)

    def _give_feedback(self, said: Said) -> bool:
        passed = self._publish("feedback", said.message)
        if passed:
            self._decided(said)
        return passed

    def _decided(self, said: Said) -> None:
        """Feedback was passed on, or not: a result may go on behind it."""
        with self._lock:
            goal_id = said.found.status.goal_id.id
            self._feedback[goal_id] -= 1
            if self._feedback[goal_id] <= 0:
                del self._feedback[goal_id]
                self._release(time.monotonic())

    def _take_result(self, message: rospy.AnyMsg) -> None:
        if not {"feedback", "result"} & self._queues.keys():
            found = self._pass_and_report("result", message)
            if found is not None:
                with self._lock:
                    self._over(found.status.goal_id.id)
            return
        found = self._events.decoded("result", message)
        if found is None:
            return
        said = found.status
        self._events.answered(said.goal_id.id, said.status, found.header)
        if "result" in self._queues:
            with self._lock:
                self._statuses.deciding(said.goal_id.id)
        event = self._events.event("result", found, found.result, said.goal_id.id, code=said.status)
        self._pass_on("result", Said(0, message, found), event)

    def _give_result(self, said: Said) -> bool:
        with self._lock:
            if self._stopped:
                return False
            said.since = time.monotonic()
            self._behind.append(said)
            self._release(said.since)
        return True

    def _release(self, now: float) -> None:
        """Pass on the results that no feedback of their goals is decided before, or not any more."""
        behind, self._behind = self._behind, []
        for said in behind:
            goal_id = said.found.status.goal_id.id
            if self._feedback[goal_id] and now - said.since < BEHIND:
                self._behind.append(said)
                continue
            self._publish("result", said.message)
            self._over(goal_id)

    def _deny_result(self, said: Said, reason: str) -> None:
        own = status(said.found.status.goal_id, GoalStatus.ABORTED, f"denied: {reason}")
        denied = write(self._types.inner["result"](), self._denied, lookup_installed)
        with self._lock:
            self._end(own, denied)

    def _end(self, own: GoalStatus, result: Any) -> None:
        """Let clients have an end of the proxy's own, as its result and in the statuses."""
        given = self._types.topics["result"](status=own, result=result)
        given.header.stamp = rospy.get_rostime()
        self._publish("result", given)
        self._statuses.give(own, time.monotonic())
        self._over(own.goal_id.id, show=True)

    def _over(self, goal_id: str, *, show: bool = False) -> None:
        self._underway.pop(goal_id, None)
        self._statuses.settled(goal_id)
        if show or "result" in self._queues:
            self._show()

    def _take_status(self, message: rospy.AnyMsg) -> None:
        with self._lock:
            self._told = self._told or self._is_there()
            as_it_is = self._told and not self._statuses.rewriting
            if as_it_is:
                if not self._pass_unread("status", message):
                    return
                self._status, self._statuses.last = message, None
                if not self._events.wants_statuses:
                    return
            array = self._events.decoded("status", message)
            if array is None:
                return
            self._status = message
            self._events.changed(array, self._statuses.changes(array))
            if not as_it_is:
                self._show()

    def _show(self) -> None:
        """Publish how goals stand, as clients are to see it: the server's last array, byte for byte where it can be."""
        if self._status is None or not self._told:  # clients send goals as soon as they hear of a server
            return
        if self._statuses.last is None:
            array = self._events.decoded("status", self._status)
            self._statuses.changes(array)
        shown = self._statuses.view(time.monotonic())
        self._publish("status", self._status if shown is self._statuses.last else shown)

    # Whether it is there

    def _is_there(self) -> bool:
        heard, hearing = (self._subscribers[kind] for kind in TO_CLIENT), [self._publishers[kind] for kind in TO_SERVER]
        return connected(heard, hearing)

    def _look_for_server(self, now: float) -> None:
        before, self._server = self._server, headers(self._subscribers["status"])
        if any(all(header is not other for other in self._server) for header in before):
            self._told, self._status, self._statuses.last = False, None, None  # late clients must not hear it
            topic = self._publishers["status"].impl
            if topic is not None:
                topic.latch = None
            self._gone = now
        if self._gone is None:
            return
        if self._server:  # of goals that it does not know its statuses tell
            for goal_id in self._underway:
                self._statuses.settled(goal_id)
            self._underway.clear()
            self._gone, self._lost_goals = None, 0
        elif self._underway and now - self._gone > AWAY:
            left = list(self._underway.values())
            self._lost_goals += len(left)
            for goal in left:
                own = status(goal, GoalStatus.ABORTED, f"the server of {self._name} has gone")
                self._end(own, self._types.inner["result"]())

    def _pass_early(self, now: float) -> None:
        """Pass on what waits for the server, or reject it where that takes too long."""
        early = [goal for goal in self._waiting.values() if goal.allowed is not None]
        there = bool(early) and self._is_there()
        for goal in early:
            if there:
                self._send_goal(goal)
            elif goal.allowed is not None and now - goal.allowed > AWAY:
                self._answer(goal, GoalStatus.REJECTED, f"{self._name} has no server")
                self._board.error(f"{self._name} has no server: goal {goal.number} is rejected")

    # All kinds

    def _catch_up(self) -> None:
        """Wait until all that has passed is reported: what a client does then comes behind what it has heard."""
        for busy in (self._reporting, self._lock):
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
            if not self._pass_unread(kind, message):
                return None
            time.sleep(0)  # rospy writes in a thread, which would wait until all this is done
            if kind == "feedback" and not self._events.reads(kind):
                return None
            found = self._events.decoded(kind, message)
            self._events.answer(kind, found)
            return found

    def _pass_unread(self, kind: str, message: rospy.AnyMsg) -> bool:
        try:
            self._types.check(kind, header_of(message))
        except CodecError:  # `look` tells it
            return False
        return self._publish(kind, message)

    def _publish(self, kind: str, message: Any) -> bool:
        with self._lock:
            if self._stopped:
                return False
            try:
                self._publishers[kind].publish(message)
            except rospy.ROSException:  # ROS is shut down, as by `rosnode kill`
                return False
            return True
