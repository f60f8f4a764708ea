"""Goals that a server has accepted and their clients believe rejected: it is asked to cancel them until they end."""

from __future__ import annotations

import time
from functools import partial
from typing import TYPE_CHECKING, Any

from action_msgs.msg import GoalInfo
from action_msgs.srv import CancelGoal
from unique_identifier_msgs.msg import UUID

from oracle_ros2.relay import MOST
from oracle_ros2.statuses import FINAL, Statuses

if TYPE_CHECKING:
    from oracle_ros2.goals import Goal
    from oracle_ros2.relay import Relay

AGAIN = 1.0
"""Seconds until a goal that goes on is cancelled again."""
_SHOWN = 3  # goals that are named among what is wrong
_GONE = (CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID, CancelGoal.Response.ERROR_GOAL_TERMINATED)


def cancel_request(goal: Goal) -> Any:
    """The request to cancel one goal."""
    return CancelGoal.Request(goal_info=GoalInfo(goal_id=UUID(uuid=list(goal))))


class Withdrawals:
    """The goals of one action that are to be ended; of more than `MOST`, as where a server hangs, the newest."""

    def __init__(self, relay: Relay) -> None:
        """`relay`: that of the service that cancels."""
        self._relay = relay
        self._due: dict[Goal, float] = {}
        self._asked: dict[Goal, Any] = {}  # what the last request for each is forgotten by

    def add(self, goal: Goal) -> None:
        """Let a goal be cancelled; from any thread."""
        self._due.setdefault(goal, 0.0)

    def catch_up(self, statuses: Statuses) -> None:
        """Cancel what is due, and forget what has ended by these statuses; to be called often."""
        now = time.monotonic()
        for goal in list(self._due)[:-MOST]:
            self._forget(goal)
        for goal, due in list(self._due.items()):
            if statuses.get(goal) in FINAL:
                self._forget(goal)
            elif due <= now and self._relay.is_there:
                self._due[goal] = now + AGAIN
                self._relay.forget(self._asked.get(goal))
                self._asked[goal] = self._relay.send(cancel_request(goal), partial(self._answered, goal))

    def troubles(self) -> list[str]:
        """What is to be said of those that go on."""
        goals = list(self._asked)
        named = [
            f"goal {goal.hex()} may go on at the server, and its client was told otherwise; "
            "it is cancelled until it ends"
            for goal in goals[:_SHOWN]
        ]
        return [*named, f"so are {len(goals) - _SHOWN} more"] if len(goals) > _SHOWN else named

    def _answered(self, goal: Goal, response: Any) -> None:
        if response.return_code in _GONE:
            self._forget(goal)

    def _forget(self, goal: Goal) -> None:
        self._due.pop(goal, None)
        self._relay.forget(self._asked.pop(goal, None))
