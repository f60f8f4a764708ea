"""The goals of a proxied action: those that wait for its server, those that it has, and how they end without it."""

from __future__ import annotations

import time
from collections import OrderedDict
from typing import Any, Callable, List, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from oracle_ros1.actionevents import KEPT, ActionEvents
from oracle_ros1.actionmessages import Goal, Said, covers
from oracle_ros1.actionshown import ShownStatuses
from oracle_ros1.actionstatus import status
from oracle_ros1.actiontopics import ActionTopics
from oracle_ros1.headers import Header

AWAY = 2.0
"""Seconds that a server may take to be connected, or to come back."""


class Goals:
    """All of it holds the lock of the action's topics."""

    def __init__(
        self, events: ActionEvents, topics: ActionTopics, shown: ShownStatuses, error: Callable[[str], None], *,
        asks_results: bool,
    ) -> None:  # fmt: skip
        """`error` tells people; `asks_results`: what statuses say of ends must wait for decisions."""
        self._name, self._types, self._expect_reply = events.name, events.types, events.expect_reply
        self._topics, self._shown, self._error, self._asks_results = topics, shown, error, asks_results
        self._waiting: "OrderedDict[int, Goal]" = OrderedDict()  # goals that the server has not got
        self._underway: "OrderedDict[str, GoalID]" = OrderedDict()  # goals that it has got, and no result is passed on
        self._server: List[Header] = []
        self._gone: Optional[float] = None  # since when there is no server (s)
        self._lost = 0

    @property
    def trouble(self) -> str:
        """What is wrong with the server."""
        return f"its server has gone; goals answered as aborted: {self._lost}" if self._lost else ""

    def begin(self, goal: Goal) -> bool:
        """A goal has come; False where nothing is taken any more."""
        with self._topics.lock:
            if not self._topics.stopped:
                self._waiting[goal.number] = goal
            return not self._topics.stopped

    def give(self, goal: Goal) -> bool:
        """Let the server have a goal, as soon as it is there."""
        with self._topics.lock:
            if self._topics.stopped or goal.number not in self._waiting:
                return False  # it was cancelled meanwhile
            goal.allowed = time.monotonic()
            early = any(other.allowed for other in self._waiting.values() if other is not goal)
            if early or not self._topics.server_is_there:
                return True
            return self._send(goal)

    def deny(self, goal: Goal, reason: str) -> None:
        """Let the client have the rejection of a goal."""
        with self._topics.lock:
            self._answer(goal, GoalStatus.REJECTED, f"denied: {reason}")

    def cancel(self, said: Said) -> bool:
        """Let the server have a cancel; the goals that it has not got, and came before, are over here."""
        with self._topics.lock:
            passed = self._topics.publish("cancel", said.message)
            for goal in list(self._waiting.values()):
                if goal.number < said.number and covers(said.found, goal.goal_id):
                    self._answer(goal, GoalStatus.RECALLED, "cancelled before the server got it")
        return passed

    def end(self, own: GoalStatus, result: Any = None) -> None:
        """Let clients have an end of the proxy's own, as its result and in the statuses."""
        if result is None:
            result = self._types.inner["result"]()
        given = self._types.topics["result"](status=own, result=result)
        given.header.stamp = rospy.get_rostime()
        with self._topics.lock:
            self._topics.publish("result", given)
            self._shown.give(own)
            self.over(own.goal_id.id, show=True)

    def over(self, goal_id: str, *, show: bool = False) -> None:
        """A goal's result was passed on; `show` that it has ended."""
        with self._topics.lock:
            self._underway.pop(goal_id, None)
            self._shown.goals.settled(goal_id)
            if show or self._asks_results:
                self._shown.show()

    def look(self) -> None:
        """Look for the server: goals that wait for it go on, and those that it has left end."""
        now = time.monotonic()
        with self._topics.lock:
            self._look_for_server(now)
            self._shown.look()
            self._pass_early(now)

    def stop(self) -> bool:
        """Reject what the server has not got, and give nothing more; whether there was something."""
        with self._topics.lock:
            left = list(self._waiting.values())
            for goal in left:
                self._answer(goal, GoalStatus.REJECTED, "the monitor ends")
            self._topics.stopped = True
            going = len(self._underway)
        if going:
            self._error(f"{self._name}: the monitor ends; goals that go on at the server: {going}")
        return bool(left)

    def _send(self, goal: Goal) -> bool:
        del self._waiting[goal.number]
        goal_id = goal.goal_id.id
        self._underway[goal_id] = goal.goal_id
        self._shown.goals.renew(goal_id)
        if len(self._underway) > KEPT:
            self._shown.goals.settled(self._underway.popitem(last=False)[0])
        if self._asks_results:
            self._shown.goals.open(goal_id)
        self._expect_reply(goal_id, goal.number)
        return self._topics.publish("goal", goal.message)

    def _answer(self, goal: Goal, code: int, text: str) -> None:
        """Let a client have the end of a goal that the server has not got, unless it has it.

        Nothing is said of one that was sent again under its id while that goes on: servers take no notice of it either.
        """
        if self._waiting.pop(goal.number, None) is None:
            return
        if goal.take_back is not None and goal.allowed is not None:
            goal.take_back()
        if goal.goal_id.id not in self._underway:
            self.end(status(goal.goal_id, code, text))

    def _look_for_server(self, now: float) -> None:
        before, self._server = self._server, self._topics.servers
        if any(all(header is not other for other in self._server) for header in before):
            self._shown.forget()
            self._gone = now
        if self._gone is None:
            return
        if self._server:  # of goals that it does not know its statuses tell
            for goal_id in self._underway:
                self._shown.goals.settled(goal_id)
            self._underway.clear()
            self._gone, self._lost = None, 0
        elif self._underway and now - self._gone > AWAY:
            left = list(self._underway.values())
            self._lost += len(left)
            for goal in left:
                self.end(status(goal, GoalStatus.ABORTED, f"the server of {self._name} has gone"))

    def _pass_early(self, now: float) -> None:
        """Pass on what waits for the server, or reject it where that takes too long."""
        early = [goal for goal in self._waiting.values() if goal.allowed is not None]
        there = bool(early) and self._topics.server_is_there
        for goal in early:
            if there:
                self._send(goal)
            elif goal.allowed is not None and now - goal.allowed > AWAY:
                self._answer(goal, GoalStatus.REJECTED, f"{self._name} has no server")
                self._error(f"{self._name} has no server: goal {goal.number} is rejected")
