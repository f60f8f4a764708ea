"""Actions that are only observed: by what their server tells of its calls, and by feedback and status."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, Mapping, NamedTuple

from action_msgs.msg import GoalInfo, GoalStatusArray
from action_msgs.srv import CancelGoal
from oracle_adapter.calls import call_numbers
from oracle_adapter.fields import not_there
from oracle_adapter.unread import Unread
from rclpy.serialization import deserialize_message

from oracle_ros2.codec import CodecError, lacking, load_type, reader
from oracle_ros2.endpoints import MatchedSubscription
from oracle_ros2.graph import hidden
from oracle_ros2.numbering import Numbers, source_of
from oracle_ros2.standing import StatusStream
from oracle_ros2.statuses import read, word
from oracle_ros2.topics import Observed, unreadable
from oracle_ros2.unserved import UnservedAction

if TYPE_CHECKING:
    from oracle_adapter import TimeSource
    from oracle_adapter.interfaces import Interface, Stream

    from oracle_ros2.goals import Goal
    from oracle_ros2.shared import Shared

MOST = 10_000
"""Calls without an answer that are remembered."""
SERVICES = {"goal": "send_goal", "reply": "send_goal", "cancel": "cancel_goal", "result": "get_result"}
_REQUEST, _RESPONSE = 1, 2  # REQUEST_RECEIVED and RESPONSE_SENT of service_msgs/ServiceEventInfo, which Humble lacks


class Told(NamedTuple):
    """That a server tells of a call: when, by its message, and what takes how much was lost before."""

    info: Any
    take_lost: Callable[[], int]


class CallStream:
    """Goals, replies, cancels or results, as the server tells of them."""

    time_source: TimeSource = "middleware"

    def __init__(self, shared: Shared, stream: Stream, message_type: Any) -> None:
        self._link = shared.link
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.latency: int = stream["latency"]
        unread = lacking(message_type, stream.get("reads") or ())
        self.lacking = not_there(f"the {self.kind} of {stream['type']}", unread)
        """Which fields the spec reads that the type does not have here."""
        self._read = reader(message_type, stream["fields"], shared.frame)

    def send(self, told: Told, message: Any, goal: Goal, call: int | None = None, status: str | None = None) -> None:
        """Report one of them."""
        stamp = told.info.stamp.sec * 10**9 + told.info.stamp.nanosec
        goal_id, lost = goal.hex() if any(goal) else "", told.take_lost()
        self._link.send(
            self.name, self.kind, stamp or None, self._read(message),
            call=call, goal_id=goal_id, status=status, lost=lost,
        )  # fmt: skip


class ServiceEvents:
    """What a server tells of the calls of one of an action's services."""

    def __init__(
        self, shared: Shared, service: str, service_type: Any,
        on_request: Callable[[Told, Any, int], Goal], on_response: Callable[[Told, Any, int, Goal], None],
    ) -> None:  # fmt: skip
        if not hasattr(service_type, "Event"):
            raise CodecError(f"{service} can't be observed: services tell of their calls since ROS 2 Iron")
        self._type, self._service = service_type.Event, service
        self._on_request, self._on_response = on_request, on_response
        self._numbers, self._calls = Numbers(), call_numbers()
        self._open: dict[tuple[bytes, int], tuple[int, Goal]] = {}
        self.count = 0
        """How many messages have come."""
        self.unread = Unread()
        """What was missed, or can't be read, until an event tells it."""
        self._empty = False  # it tells of calls, and not what was in them
        self._unreadable = ""  # why the last message can't be read
        self.subscription = MatchedSubscription(shared.node, self._type, f"{service}/_service_event", self._take)

    def look(self, served: bool) -> list[str]:
        """Look at the other nodes again, and return what is wrong."""
        troubles = [self.subscription.look()]
        if self._unreadable:
            troubles.append(f"what is told of calls of {self._service} can't be read: {self._unreadable}")
        if served and not self.subscription.sources:
            troubles.append(f"nobody tells of {self._service}: its server has to turn introspection on")
        elif self._empty:
            troubles.append(f"what is in calls of {self._service} is not told: its server has to turn CONTENTS on")
        return troubles

    def _take(self, message: bytes, info: Mapping[str, Any]) -> None:
        missed = self._numbers.missed(source_of(info), info)
        if missed < 0:
            return
        self.count += 1
        self.unread.add(missed)
        try:
            event = deserialize_message(message, self._type)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            self._unreadable = str(error) or type(error).__name__
            self.unread.add()
            return
        self._unreadable = ""
        if event.info.event_type not in (_REQUEST, _RESPONSE):
            return  # a client's side of it
        told, asking = Told(event.info, self.unread.take), event.info.event_type == _REQUEST
        content = list(event.request if asking else event.response)
        self._empty = not content
        key = bytes(event.info.client_gid), event.info.sequence_number
        if not content:
            return
        if asking:
            call = next(self._calls)
            self._open[key] = call, self._on_request(told, content[0], call)
            if len(self._open) > MOST:
                del self._open[next(iter(self._open))]
        elif key in self._open:  # else it was asked before this was heard
            call, goal = self._open.pop(key)
            self._on_response(told, content[0], call, goal)


class IntrospectedAction:
    """Reports what an action's server tells of itself."""

    bypass = ""

    def __init__(self, shared: Shared, action: Interface) -> None:
        """Raises `CodecError`."""
        node, streams, name = shared.node, action.streams, shared.names[action.name]
        self._link, self._board, self.name = shared.link, shared.board, action.name
        kind = load_type(action.first["type"])
        impl = kind.Impl
        contents = {"goal": kind.Goal, "reply": impl.SendGoalService.Response,
                    "cancel": GoalInfo, "result": kind.Result}  # fmt: skip
        self._sides = {kind: CallStream(shared, s, contents[kind]) for kind, s in streams.items() if kind in contents}
        types = {"send_goal": impl.SendGoalService, "cancel_goal": CancelGoal, "get_result": impl.GetResultService}
        takes = {"send_goal": (self._goal, self._reply), "cancel_goal": (self._cancel, _nothing),
                 "get_result": (_asked, self._result)}  # fmt: skip
        wanted = {SERVICES[kind]: None for kind in self._sides}
        self._events = [ServiceEvents(shared, hidden(name, s), types[s], *takes[s]) for s in wanted]

        self._feedback = self._status = None
        self._numbers = Numbers()
        self._unserved = UnservedAction(node, name)
        self.doubt = ""
        """That nobody has served it so far, as of the last look."""
        self.subscription: Any = None
        if "feedback" in streams:
            envelope = impl.FeedbackMessage, "feedback"
            self._feedback = self.observed = Observed(node, streams["feedback"], envelope=envelope, frame=shared.frame)
            self.subscription = MatchedSubscription(node, envelope[0], hidden(name, "feedback"), self._take_feedback)
            self.observed.is_foreign = self.subscription.is_foreign
        self._statuses: MatchedSubscription | None = None
        if "status" in streams:
            self._status = StatusStream(shared, streams["status"])
            self._statuses = MatchedSubscription(node, GoalStatusArray, hidden(name, "status"), self._take_status)
        observed = {**self._sides, "feedback": self._feedback, "status": self._status}
        self.streams: list[CallStream | Observed | StatusStream] = [
            found for kind in streams if (found := observed[kind]) is not None
        ]

    @property
    def received(self) -> int:
        """How many messages have come."""
        return sum(events.count for events in self._events) + (self._feedback.count if self._feedback else 0)

    @property
    def _subscriptions(self) -> list[MatchedSubscription]:
        found = [*(events.subscription for events in self._events), self._statuses, self.subscription]
        return [subscription for subscription in found if subscription is not None]

    def catch_up(self) -> None:
        """Take what has come by now."""
        for subscription in self._subscriptions:
            subscription.take_all()

    def look(self) -> str:
        """Look at the other nodes again, and return what is wrong."""
        self.doubt = self._unserved.look()
        self._link.lost(sum(events.unread.overdue() for events in self._events))
        troubles = [trouble for events in self._events for trouble in events.look(self._unserved.is_served)]
        troubles += [side.lacking for side in self._sides.values()]
        if self._feedback is not None:
            untold = self._link.lost(self._feedback.unread.overdue())
            troubles += [
                self.subscription.look(),
                self._feedback.misplaced,
                self._feedback.lacking,
                *unreadable(self, untold),
            ]
        if self._statuses is not None and self._status is not None:
            troubles.append(self._statuses.look())
            self._status.keep(self._statuses.sources)
        return "; ".join(trouble for trouble in troubles if trouble)

    def stop(self) -> None:
        """Take no more."""
        for subscription in self._subscriptions:
            subscription.stop()

    def _goal(self, told: Told, request: Any, call: int) -> Goal:
        goal = bytes(request.goal_id.uuid)
        if "goal" in self._sides:
            self._sides["goal"].send(told, request.goal, goal, call)
        return goal

    def _reply(self, told: Told, response: Any, call: int, goal: Goal) -> None:
        if "reply" in self._sides:
            status = "accepted" if response.accepted else "rejected"
            self._sides["reply"].send(told, response, goal, call, status)

    def _cancel(self, told: Told, request: Any, call: int) -> Goal:
        goal = bytes(request.goal_info.goal_id.uuid)
        self._sides["cancel"].send(told, request.goal_info, goal, call)
        return goal

    def _result(self, told: Told, response: Any, _call: int, goal: Goal) -> None:
        self._sides["result"].send(told, response.result, goal, status=word(response.status))

    def _take_feedback(self, message: bytes, info: Mapping[str, Any]) -> None:
        event = self.observed.event(message, info)
        if event is not None:
            stamp, data, more = event
            more["goal_id"] = message[4:20].hex()
            self._link.send(self.observed.name, self.observed.kind, stamp, data, **more)

    def _take_status(self, array: bytes, info: Mapping[str, Any]) -> None:
        lost = self._numbers.missed(source_of(info), info)
        if lost < 0 or self._status is None:
            return
        try:
            statuses = read(array)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            self._board.failed(self.name, f"a status array of {self.name}", error)
            self._status.unread.add(lost + 1)
            return
        self._status.take(statuses, info, lost)


def _asked(_told: Told, request: Any, _call: int) -> Goal:
    return bytes(request.goal_id.uuid)


def _nothing(_told: Told, _response: Any, _call: int, _goal: Goal) -> None:
    """What is answered to a cancel is no event."""
