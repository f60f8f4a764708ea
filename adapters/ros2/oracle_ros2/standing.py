"""How an action's goals stand, behind its proxy: told after the reply, and so that it matches a result withheld."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple

from action_msgs.msg import GoalStatusArray
from oracle_adapter.unread import Unread
from rclpy.qos import qos_profile_action_status_default

from oracle_ros2.circles import topic_circle
from oracle_ros2.endpoints import MatchedSubscription
from oracle_ros2.numbering import Numbers, source_of
from oracle_ros2.republished import MatchedPublisher
from oracle_ros2.stamps import simulated, time_of
from oracle_ros2.statuses import FINAL, Statuses, Transitions, changed, read, word

if TYPE_CHECKING:
    from oracle_adapter import Stamp, TimeSource
    from oracle_adapter.interfaces import Stream

    from oracle_ros2.goals import Goals
    from oracle_ros2.shared import Shared

LONGEST = 1.0
"""Seconds that an array waits for replies, and for a result to be decided on."""
HELD = 1000
"""Arrays that wait; of more the oldest are lost."""


class StatusStream:
    """An event a goal and transition, of arrays as they come."""

    def __init__(self, shared: Shared, stream: Stream, *, stamped_here: bool = False) -> None:
        self._link, node = shared.link, shared.node
        self._now = time_of(node)
        self._stamped_here = stamped_here
        self._timed_here = stamped_here or simulated(node)
        self._began = time.time_ns()
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.latency: int | None = None if stamped_here else stream["latency"]
        self.time_source: TimeSource = "arrival" if self._timed_here else "middleware"
        self._transitions = Transitions()
        self.unread = Unread()
        """Arrays that were lost, or can't be read, until an event tells it."""

    def take(self, statuses: Statuses, info: Mapping[str, Any], lost: int) -> None:
        """Report what an array says that its publisher's last one did not; `lost` were lost before it.

        One that was kept for late subscribers is where the others begin.
        """
        source, published = source_of(info), info["source_timestamp"]
        if not self._transitions.knows(source):
            self._began = min(self._began, time.time_ns())  # the clock may have been set back
            if published < self._began:
                self._transitions.begin(source, statuses)
                return
        stamp: Stamp = self._now
        if not self._stamped_here:
            stamp = (self._now() if self._timed_here else published) or None
        self.unread.add(lost)
        for goal, status in self._transitions.of(source, statuses):
            missed = self.unread.take()
            self._link.send(
                self.name, self.kind, stamp, {}, source=source, lost=missed, goal_id=goal.hex(), status=word(status)
            )

    def keep(self, sources: list[str]) -> None:
        """Forget publishers that have ended, and have another event tell what none of this stream has told in time."""
        self._link.lost(self.unread.overdue())
        self._transitions.keep([source for source in self._transitions.sources if _is_there(source, sources)])


def _recent(since: float) -> bool:
    return time.monotonic() - since < LONGEST


def _is_there(source: str, sources: list[str]) -> bool:
    return any(one.startswith(source) for one in sources)


class _Unread(NamedTuple):
    """An array as it came: when (s, of the steady clock), and how many were lost before it."""

    array: bytes
    info: Mapping[str, Any]
    lost: int
    since: float


class RelayedStatus:
    """Passes arrays on as they came, unless something of their goals was withheld."""

    def __init__(self, shared: Shared, name: str, stream: Stream | None, topics: tuple[str, str], goals: Goals) -> None:
        """`topics`: where arrays come from, and where they go."""
        self._board, self._goals, self._name = shared.board, goals, name
        self.statuses: Statuses = {}
        """How the goals stand, as of the last array."""
        self.count = 0
        """How many arrays have come."""
        self.observed = None if stream is None else StatusStream(shared, stream, stamped_here=True)
        self._circle = topic_circle(shared.node, *topics)
        self._numbers = Numbers(self._match)
        self._unread: deque[_Unread] = deque()
        self._waiting: deque[tuple[bytes, Statuses, float]] = deque(maxlen=HELD)
        self._unreported: deque[tuple[Statuses, float, Mapping[str, Any], int]] = deque()
        self._last: tuple[bytes, Statuses] | None = None
        self._published = b""
        self._publisher = MatchedPublisher(shared.node, GoalStatusArray, topics[1], [qos_profile_action_status_default])
        self.subscription = MatchedSubscription(shared.node, GoalStatusArray, topics[0], self._take)

    @property
    def bypass(self) -> str:
        """Who publishes past the monitor what it forwards, or gives it back."""
        return "; ".join(filter(None, (self._publisher.bypass, self._circle.text)))

    @property
    def under_way(self) -> int:
        """How many goals have not ended."""
        with self._goals.lock:
            self._read()
        return sum(status not in FINAL for status in self.statuses.values())

    def look(self) -> list[str]:
        """Look at the other nodes again, and return what is wrong."""
        self._circle.look()
        troubles = [self.subscription.look(), self._publisher.look(self.subscription.offered), self._circle.text]
        if self.observed is not None:
            with self._goals.lock:
                self.observed.keep(self.subscription.sources)
        return troubles

    def flush(self) -> None:
        """Pass on what waits no longer, for a reply or for a result; and report what waits for no reply."""
        with self._goals.lock:
            self._read()
            while self._waiting:
                array, statuses, since = self._waiting[0]
                if not self._goals.may_show(statuses) and _recent(since):
                    break
                self._waiting.popleft()
                self._last = array, statuses
                self._publish(self._shown(array, statuses))
            self.report()

    def report(self) -> None:
        """Report what waits for no reply."""
        with self._goals.lock:
            self._read()
            while self.observed is not None and self._unreported:
                statuses, since, info, lost = self._unreported[0]
                if not self._goals.have_replies(statuses) and _recent(since):
                    break
                self._unreported.popleft()
                self.observed.take(statuses, info, lost)

    def withheld(self) -> None:
        """Say the last array again where it is told otherwise now."""
        with self._goals.lock:
            if self._last is not None:
                shown = self._shown(*self._last)
                if shown != self._published:
                    self._publish(shown)

    def stop(self) -> None:
        """Take and forward no more."""
        self.subscription.stop()
        self._publisher.stop()

    def _match(self) -> None:
        """Do not wait for the next look: a new publisher may publish only once."""
        self.subscription.look_around()
        self._publisher.match(self.subscription.offered)

    def _take(self, array: bytes, info: Mapping[str, Any]) -> None:
        if self._circle.has(source_of(info)):
            return
        lost = self._numbers.missed(source_of(info), info)
        if lost < 0:
            return
        self.count += 1
        with self._goals.lock:
            self._unread.append(_Unread(array, info, lost, time.monotonic()))
            may_wait = bool(self._goals.unsettled) and len(self._unread) < HELD
        if not may_wait:
            self.flush()

    def _read(self) -> None:
        """Read what came while replies were due: these come first, as an array of 200 is read for some 0.1 ms."""
        while self._unread:
            array, info, lost, since = self._unread.popleft()
            try:
                statuses = read(array)
            except Exception as error:  # noqa: BLE001 - whatever another node sends
                self._board.failed(self._name, f"a status array of {self._name}", error)
                if self.observed is not None:
                    self.observed.unread.add(lost + 1)
                continue
            self.statuses = statuses
            self._waiting.append((array, statuses, since))
            if self.observed is not None:
                self._unreported.append((statuses, since, info, lost))

    def _shown(self, array: bytes, statuses: Statuses) -> bytes:
        other = self._goals.shown(statuses)
        return changed(array, other.get) if other else array

    def _publish(self, array: bytes) -> None:
        self._published = array
        try:
            self._publisher.publish(array)
        except Exception as error:  # noqa: BLE001 - others wait behind it
            self._board.failed(self._name, f"a status array of {self._name}", error)
