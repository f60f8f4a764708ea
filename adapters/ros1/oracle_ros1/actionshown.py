"""The statuses that an action's clients see: the server's arrays, byte for byte where nothing was withheld."""

from __future__ import annotations

import time
from typing import Optional

import rospy
from actionlib_msgs.msg import GoalStatus

from oracle_ros1.actionevents import ActionEvents
from oracle_ros1.actionstatus import Statuses
from oracle_ros1.actiontopics import ActionTopics


class ShownStatuses:
    """All of it holds the lock of the action's topics."""

    def __init__(self, topics: ActionTopics, events: ActionEvents) -> None:
        self._topics, self._events = topics, events
        self.goals = Statuses()
        """How goals stand."""
        self._last: Optional[rospy.AnyMsg] = None
        self._told = False  # clients hear of the server

    def take(self, message: rospy.AnyMsg) -> None:
        """Pass an array on, and report what it brings where the spec wants to know."""
        with self._topics.lock:
            self._told = self._told or self._topics.server_is_there
            as_it_is = self._told and not self.goals.rewriting
            if as_it_is:
                if not self._topics.pass_on("status", message):
                    return
                self._last, self.goals.last = message, None
                if not self._events.wants_statuses:
                    return
            array = self._events.decoded("status", message)
            if array is None:
                return
            self._last = message
            self._events.changed(array, self.goals.changes(array, self._events.standing(array)))
            if not as_it_is:
                self.show()

    def show(self) -> None:
        """Say again how goals stand, as clients are to see it."""
        with self._topics.lock:
            if self._last is None or not self._told:  # clients send goals as soon as they hear of a server
                return
            if self.goals.last is None:
                array = self._events.decoded("status", self._last)
                if array is None:
                    return
                self.goals.changes(array)
            self._topics.publish("status", self.goals.view(time.monotonic()))

    def give(self, own: GoalStatus) -> None:
        """Show a status of the proxy's own."""
        self.goals.give(own, time.monotonic())

    def deciding(self, goal_id: str) -> None:
        """A goal's result is there, and decided on: meanwhile show no end."""
        with self._topics.lock:
            self.goals.deciding(goal_id)

    def look(self) -> None:
        """Let clients hear of the server once it is there."""
        with self._topics.lock:
            if not self._told and self._topics.server_is_there:
                self._told = True
                self.show()

    def forget(self) -> None:
        """The server has gone."""
        with self._topics.lock:
            self._told, self._last, self.goals.last = False, None, None
            self._topics.forget_status()
