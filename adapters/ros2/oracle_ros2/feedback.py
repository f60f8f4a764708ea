"""An action's feedback behind its proxy: it follows the reply, and is asked about where the spec says so."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Any, Mapping

from oracle_adapter.forwarding import ForwardQueue
from oracle_adapter.interfaces import is_filtered
from oracle_adapter.pacing import Pacer
from oracle_adapter.passing import Passing

from oracle_ros2.endpoints import MatchedPublisher, MatchedSubscription
from oracle_ros2.topics import Numbers, Observed, source_of, unreadable

if TYPE_CHECKING:
    from oracle_adapter.interfaces import Stream

    from oracle_ros2.goals import Goal, Goals
    from oracle_ros2.shared import Shared

HELD = 1000
"""Messages of a goal that wait for its reply; of more the oldest are lost."""


def goal_of(message: bytes) -> Goal:
    """The goal of a serialized feedback message: it begins with it."""
    return message[4:20]


class RelayedFeedback:
    """Passes feedback on as it came, and reports it where the spec has a stream of it."""

    def __init__(
        self, shared: Shared, name: str, stream: Stream | None, message_type: Any, topics: tuple[str, str], goals: Goals
    ) -> None:
        """`topics`: where feedback comes from, and where it goes."""
        self._link, self._board, self._goals, self._name = shared.link, shared.board, goals, name
        self._publisher = MatchedPublisher(shared.node, message_type, topics[1])
        self._pacer = Pacer(self._publish)
        self._held: dict[Goal, deque[bytes]] = {}
        self._numbers = Numbers(self._match)
        self.count = 0
        """How many messages have come."""
        self.observed: Observed | None = None
        self._queue: ForwardQueue | None = None
        if stream is not None:
            self.observed = Observed(shared.node, stream, envelope=(message_type, "feedback"))
            if is_filtered(stream):
                self._queue = ForwardQueue(Passing(shared.link, shared.board, stream, shared.clocks), self._release)
        self.subscription = MatchedSubscription(shared.node, message_type, topics[0], self._take)

    @property
    def bypass(self) -> str:
        """Who publishes past the monitor what it forwards."""
        return self._publisher.bypass

    def look(self) -> list[str]:
        """Look at the other nodes again, and return what is wrong."""
        troubles = [self.subscription.look(), self._publisher.look(self.subscription.offered)]
        if self.observed is not None:
            troubles += [self.observed.misplaced, self.observed.lacking, *unreadable(self)]
        return troubles

    def reply_settled(self, goal: Goal) -> None:
        """Pass on what waited for a goal's reply."""
        with self._goals.lock:
            held = self._held.pop(goal, ())
            if not self._goals.is_refused(goal):
                for message in held:
                    self._pacer.take(message)

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
        missed = self._numbers.missed(source_of(info), info)
        if missed < 0:
            return
        self.count += 1
        if self._queue is None:
            self._release(message)
        if self.observed is None:
            return
        event = self.observed.decoded(message, info, missed)
        if event is None:
            return
        stamp, data, more = event
        more["goal_id"] = goal_of(message).hex()
        if self._queue is not None:
            self._queue.take(message, stamp, data, **more)
        else:
            self._link.send(self.observed.name, self.observed.kind, stamp, data, **more)

    def _release(self, message: bytes) -> bool:
        """Pass a message on, once its goal's client has the reply."""
        goal = goal_of(message)
        with self._goals.lock:
            if self._goals.is_refused(goal):
                return False
            if self._goals.is_unsettled(goal):
                self._held.setdefault(goal, deque(maxlen=HELD)).append(message)
                return True
            return self._pacer.take(message)

    def _publish(self, message: bytes) -> None:
        try:
            self._publisher.publish(message)
        except Exception as error:  # noqa: BLE001 - others wait behind it
            self._board.failed(self._name, f"a feedback message of {self._name}", error)
