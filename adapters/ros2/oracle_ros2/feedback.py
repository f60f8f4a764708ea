"""An action's feedback behind its proxy: it follows the reply, and is asked about where the spec says so."""

from __future__ import annotations

import threading
from collections import deque
from typing import TYPE_CHECKING, Any, Mapping, NamedTuple

from oracle_adapter.behind import Behind
from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.interfaces import is_filtered
from oracle_adapter.pacing import Pacer
from oracle_adapter.passing import Passing

from oracle_ros2.circles import topic_circle
from oracle_ros2.endpoints import MatchedSubscription
from oracle_ros2.graph import unguarded
from oracle_ros2.numbering import Numbers, source_of
from oracle_ros2.republished import MatchedPublisher
from oracle_ros2.topics import Observed, unreadable

if TYPE_CHECKING:
    from oracle_adapter.interfaces import Stream

    from oracle_ros2.goals import Goal, Goals
    from oracle_ros2.shared import Shared

HELD = 1000
"""Messages of a goal that wait for its reply; of more the oldest are lost."""


def goal_of(message: bytes) -> Goal:
    """The goal of a serialized feedback message: it begins with it."""
    return message[4:20]


class _Message(NamedTuple):
    """One on its way; the number is that of `Behind`."""

    goal: Goal
    number: int
    serialized: bytes


class _Coming(NamedTuple):
    """One as it came."""

    message: _Message
    info: Mapping[str, Any]
    missed: int


class RelayedFeedback:
    """Passes feedback on as it came, behind the reply of its goal, and reports it where the spec has a stream of it."""

    def __init__(
        self, shared: Shared, name: str, stream: Stream | None, message_type: Any, topics: tuple[str, str], goals: Goals
    ) -> None:
        """`topics`: where feedback comes from, and where it goes."""
        self._link, self._board, self._goals, self._name = shared.link, shared.board, goals, name
        self._node, self._topics = shared.node, topics
        self._circle = topic_circle(shared.node, *topics)
        self._publisher = MatchedPublisher(shared.node, message_type, topics[1])
        self._pacer = Pacer(self._publish)
        self._entering = threading.RLock()  # guards what waits for a reply: that comes in the link's thread, too
        self._held: dict[Goal, deque[_Coming]] = {}
        self._numbers = Numbers(self._match)
        self.behind = Behind()
        """What comes behind feedback."""
        self.count = 0
        """How many messages have come."""
        self.observed: Observed | None = None
        self._queue: ForwardQueue | None = None
        if stream is not None:
            envelope = message_type, "feedback"
            self.observed = Observed(shared.node, stream, envelope=envelope, stamped_here=True, frame=shared.frame)
            if is_filtered(stream):
                passing = Passing(shared.link, shared.board, stream, shared.clocks)
                self._queue = ForwardQueue(passing, self._release, lambda message, _: self._settle(message))
        self.subscription = MatchedSubscription(shared.node, message_type, topics[0], self._take)
        if self.observed is not None:
            self.observed.is_foreign = self.subscription.is_foreign

    @property
    def doubt(self) -> str:
        """Who hears what does not pass, while nobody hears what does; empty where all of it passes."""
        return unguarded(self._node, *self._topics) if self._queue is not None else ""

    @property
    def bypass(self) -> str:
        """Who publishes past the monitor what it forwards, or gives it back."""
        return "; ".join(filter(None, (self._publisher.bypass, self._circle.text)))

    def look(self) -> list[str]:
        """Look at the other nodes again, and return what is wrong."""
        self._circle.look()
        troubles = [self.subscription.look(), self._publisher.look(self.subscription.offered), self._circle.text]
        if self.observed is not None:
            with self._entering:
                overdue = self.observed.unread.overdue()
            untold = self._link.lost(overdue)
            troubles += [self.observed.misplaced, self.observed.lacking, *unreadable(self, untold)]
        return troubles

    def reply_settled(self, goal: Goal) -> None:
        """Go on with what waited for a goal's reply."""
        with self._entering:
            for coming in self._held.pop(goal, ()):
                self._enter(coming)

    def stop(self) -> None:
        """Take and forward no more."""
        self.subscription.stop()
        self._pacer.stop()
        self._publisher.stop()

    def _match(self) -> None:
        """Do not wait for the next look: a new publisher may publish only once."""
        self.subscription.look_around()
        self._publisher.match(self.subscription.offered)

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        if self._circle.has(source_of(info)):
            return
        missed = self._numbers.missed(source_of(info), info)
        if missed < 0:
            return
        self.count += 1
        goal = goal_of(message)
        coming = _Coming(_Message(goal, self.behind.came(goal), message), info, missed)
        with self._entering:
            if self._goals.is_unsettled(goal) or goal in self._held:
                self._hold(coming)
            else:
                self._enter(coming)

    def _hold(self, coming: _Coming) -> None:
        held = self._held.setdefault(coming.message.goal, deque())
        held.append(coming)
        if len(held) > HELD:
            lost = held.popleft()
            held[0] = held[0]._replace(missed=held[0].missed + lost.missed + 1)
            self._settle(lost.message)

    def _enter(self, coming: _Coming) -> None:
        """Pass a message on and report it, or ask about it."""
        message, observed = coming.message, self.observed
        if self._queue is None:
            self._release(message)
        if observed is None:
            return
        event = observed.decoded(message.serialized, coming.info, coming.missed)
        if event is None:
            if self._queue is not None:
                self._settle(message)
            return
        stamp, data, more = event
        more["goal_id"] = message.goal.hex()
        if self._queue is not None:
            self._queue.take(message, stamp, data, **more)
        else:
            self._link.send(observed.name, observed.kind, stamp, data, **more)

    def _release(self, message: _Message) -> bool:
        """Pass a message on; not where its goal's client believes that this was rejected."""
        passed = not self._goals.is_refused(message.goal) and self._pacer.take(message)
        if not passed:
            self._settle(message)
        return passed

    def _publish(self, message: _Message) -> None:
        try:
            self._publisher.publish(message.serialized)
        except Exception as error:  # noqa: BLE001 - others wait behind it
            self._board.failed(self._name, f"a feedback message of {self._name}", error)
        self._settle(message)

    def _settle(self, message: _Message) -> None:
        self.behind.settle(message.goal, message.number)
