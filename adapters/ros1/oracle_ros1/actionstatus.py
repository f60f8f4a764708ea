"""How an action's goals stand: what its server says of them, and what its clients are to see."""

from __future__ import annotations

import copy
import math
from typing import Dict, List, Optional, Tuple

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus

from oracle_ros1.statusarray import Entry, StatusArray, entry_of

SHOWN = 5.0
"""Seconds for which a status of the proxy's own is shown, as servers show those of goals that are over."""
LAG = 1.0
"""Seconds that a result may come behind the status that says so."""

WORDS = {
    GoalStatus.PENDING: "unknown",  # the server has it, and has not said whether it takes it
    GoalStatus.ACTIVE: "executing",
    GoalStatus.PREEMPTED: "canceled",
    GoalStatus.SUCCEEDED: "succeeded",
    GoalStatus.ABORTED: "aborted",
    GoalStatus.REJECTED: "rejected",
    GoalStatus.PREEMPTING: "canceling",
    GoalStatus.RECALLING: "canceling",
    GoalStatus.RECALLED: "canceled",
    GoalStatus.LOST: "unknown",
}
_SERVERS = 100
"""Servers of which the last array is remembered: one that is started again may have another name each time."""
_UNDECIDED = frozenset({GoalStatus.PENDING, GoalStatus.RECALLING, GoalStatus.LOST})
_REFUSED = frozenset({GoalStatus.REJECTED, GoalStatus.RECALLED})
_ENDED = frozenset({GoalStatus.PREEMPTED, GoalStatus.SUCCEEDED, GoalStatus.ABORTED, *_REFUSED})


def word(code: int) -> str:
    """What a status is called in events."""
    return WORDS.get(code, "unknown")


def accepted(code: int) -> Optional[bool]:
    """Whether a goal of this status was accepted; None while that is open."""
    return None if code in _UNDECIDED else code not in _REFUSED


def status(goal: GoalID, code: int, text: str) -> GoalStatus:
    """A goal's status; the goal stays as it is."""
    return GoalStatus(copy.deepcopy(goal), code, text)


class Statuses:
    """The statuses of an action's goals. All times are in seconds, of a clock that never goes back."""

    def __init__(self) -> None:
        self.last: Optional[StatusArray] = None
        """The server's last array, where it was read."""
        self._codes: Dict[str, Dict[str, int]] = {}  # of the last array of each server, the latest one last
        self._own: Dict[str, Tuple[Entry, float]] = {}  # given by the proxy, and until when
        self._open: Dict[str, float] = {}  # goals whose results are asked about: until when no end of them is shown
        self._shown: Dict[str, Entry] = {}  # of these, what clients saw last

    @property
    def rewriting(self) -> bool:
        """Whether clients may have to see another array than the server's."""
        return bool(self._own or self._open)

    def give(self, own: GoalStatus, now: float) -> None:
        """Show this status for a goal, for `SHOWN` seconds and as long as the server shows one of it."""
        self._own[own.goal_id.id] = entry_of(own), now + SHOWN

    def renew(self, goal_id: str) -> None:
        """The server gets a goal, whose id may be that of one that the proxy ended: its own status counts from now."""
        self._own.pop(goal_id, None)

    def open(self, goal_id: str) -> None:
        """Show no end of this goal before its result is there, for `LAG` seconds at most."""
        self._open.setdefault(goal_id, math.nan)

    def deciding(self, goal_id: str) -> None:
        """Its result is there: show no end of this goal before that is settled."""
        self._open[goal_id] = math.inf

    def settled(self, goal_id: str) -> None:
        """Its result is settled: the server's status is shown again, or the one that was given."""
        self._open.pop(goal_id, None)
        self._shown.pop(goal_id, None)

    def changes(self, array: StatusArray, standing: Optional[Dict[str, int]] = None) -> List[Tuple[str, int]]:
        """Take a server's next array; the goals of another status than in its last one.

        Before its first one goals were `standing` so. Goals that the proxy has refused are none of them: the server
        knows these from cancels only.
        """
        codes, source = {entry.goal_id.id: entry.code for entry in array.entries}, array.source
        before = self._codes.pop(source, standing or {})
        self._codes[source], self.last = codes, array
        if len(self._codes) > _SERVERS:
            del self._codes[next(iter(self._codes))]
        refused = {goal for goal, (own, _) in self._own.items() if own.code in _REFUSED}
        return [(goal, code) for goal, code in codes.items() if before.get(goal) != code and goal not in refused]

    def told(self, goal_id: str) -> Optional[int]:
        """How a goal stood when a server last said it; None where none has."""
        last = reversed(list(self._codes.values()))  # a copy: the next array may just come
        return next((codes[goal_id] for codes in last if goal_id in codes), None)

    def view(self, now: float) -> Optional[rospy.AnyMsg]:
        """What clients are to see of the last array; as it came where that is as the server has it."""
        array = self.last
        if array is None:
            return None
        there = {entry.goal_id.id for entry in array.entries}
        self._own = {goal: own for goal, own in self._own.items() if own[1] > now or goal in there}
        entries = [self._seen(entry, now) for entry in array.entries]
        return array.having([*entries, *(own for goal, (own, _) in self._own.items() if goal not in there)])

    def _seen(self, entry: Entry, now: float) -> Entry:
        goal = entry.goal_id.id
        if goal in self._own:
            return self._own[goal][0]
        if goal not in self._open:
            return entry
        if entry.code not in _ENDED:
            self._shown[goal] = entry
            return entry
        if math.isnan(self._open[goal]):
            self._open[goal] = now + LAG
        if self._open[goal] <= now:
            self.settled(goal)
            return entry
        return self._shown.get(goal) or entry_of(status(entry.goal_id, GoalStatus.PENDING, ""))
