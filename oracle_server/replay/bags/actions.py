"""The messages of a bag on the topics beneath an action as its events."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import count
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from oracle_server.core.kinds import Kind, Status
from oracle_server.core.plan import Plan
from oracle_server.core.stamps import stamp_in
from oracle_server.replay.bags.actiontypes import action_types
from oracle_server.replay.bags.definitions import type_name, types_of
from oracle_server.replay.bags.messages import Read, message_reader
from oracle_server.replay.bags.serviceevents import Calls, Half
from oracle_server.replay.bags.sources import Item, Topic, decoder, read_fields
from oracle_server.replay.files.storage import Channel

_ROS2: tuple[Status, ...] = ("unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted")
_ROS1: tuple[Status, ...] = (
    "unknown", "executing", "canceled", "succeeded", "aborted", "rejected", "canceling", "canceling", "canceled",
    "unknown",
)  # fmt: skip
"""How a goal stands, by the numbers of GoalStatus: pending and lost ones are `unknown`."""
_UNDECIDED, _REFUSED = frozenset({0, 7, 9}), frozenset({5, 8})
"""Of ROS 1: whether the goal was accepted is not known yet; it was not."""


class Action:
    """What the topics of one action tell each other."""

    def __init__(self) -> None:
        self.numbers = count(1)
        """Numbers of calls."""
        self.calls: dict[str, int] = {}
        """The calls of goals, by their ids."""
        self.passed: set[str] = set()
        """The goals that passed, as far as `passed_known`."""
        self.passed_known = False
        self.replied: set[str] = set()
        """Of ROS 1: the goals whose reply was seen, in a status or a result."""


class ActionSource:
    """Decodes the messages of one channel beneath an action."""

    lasts = False

    def __init__(self, channel: Channel, topic: Topic, ready: Plan, known: Typestore, action: Action) -> None:
        """Prepare to decode. Raises `TraceError` where the type of the messages is not known."""
        assert topic.role is not None and topic.role.port is not None  # noqa: S101, PT018 -- it is an action's
        self.topic, self._action, self._role = topic, action, topic.role
        self._type, topic.type = type_name(channel.type), channel.type
        self._types = types_of(channel, known, action_types(channel, known))
        self._decode, self._ros1 = decoder(channel, self._types), channel.serialization == "ros1"
        self._plan = ready
        self._keys = {key.kind: key for key in topic.role.streams}
        self._make: Callable[[Any], Iterator[Item]] = self._by_port()[topic.role.port.topic]
        self._inner: dict[Kind, Read] = {}

    def survey(self, _time: int, raw: bytes) -> None:
        """Look at a message before all of them are read."""
        message = self._decode(raw, self._type)
        if self.topic.is_service:
            self.topic.events.add(message.info.event_type)
        if not self._role.passes:
            return
        if not self.topic.is_service:
            self._action.passed.add(str(message.goal_id.id))
        elif len(message.request):
            self._action.passed.add(_hex(message.request[0].goal_id))
        self._action.passed_known = True

    def items(self, raw: bytes, published: Callable[[], int | None]) -> list[Item]:
        """The events that a message is, `published` (ns) where they do not say. Raises whatever decoding raises."""
        found = self._make(self._decode(raw, self._type))
        return [item if item.stamp is not None else item._replace(stamp=published()) for item in found]

    def _by_port(self) -> Mapping[str, Callable[[Any], Iterator[Item]]]:
        return {
            "_action/send_goal/_service_event": self._sent_goal,
            "_action/get_result/_service_event": self._got_result,
            "_action/cancel_goal/_service_event": self._cancelled,
            "_action/feedback": self._told,
            "_action/status": self._statuses,
            "goal": self._goal1,
            "cancel": self._cancel1,
            "feedback": self._feedback1,
            "result": self._result1,
            "status": self._statuses1,
        }

    # ROS 2

    def _sent_goal(self, message: Any) -> Iterator[Item]:
        half = self._half(message)
        if half is None:
            return
        if half.kind == "request":
            goal = self.topic.goals[half.call] = _hex(half.content.goal_id)
            yield from self._of_goal(goal, half.content, f"{self._prefix('_Event')}_Request", half.stamp)
            return
        goal = self._goal_of(half)
        word: Status = "accepted" if half.content.accepted else "rejected"
        data = {"accepted": bool(half.content.accepted), "stamp": _time(half.content.stamp)}
        yield from self._item("reply", goal, data, half.stamp, word, self._action.calls.get(goal))

    def _got_result(self, message: Any) -> Iterator[Item]:
        half = self._half(message)
        if half is None:
            return
        if half.kind == "request":
            self.topic.goals[half.call] = _hex(half.content.goal_id)
            return
        goal, word = self._goal_of(half), _word(_ROS2, half.content.status)
        if "result" in self._keys:
            data = self._plain("result", f"{self._prefix('_Event')}_Response", half.content)
            yield from self._item("result", goal, data, half.stamp, word)

    def _cancelled(self, message: Any) -> Iterator[Item]:
        half = self._half(message)
        if half is None or half.kind != "request":
            return
        info = half.content.goal_info
        data = message_reader(self._types, "action_msgs/msg/GoalInfo", None)(info)
        goal = _hex(info.goal_id)
        yield from self._item("cancel", goal.strip("0") and goal, data, half.stamp, None, next(self._action.numbers))

    def _told(self, message: Any) -> Iterator[Item]:
        if "feedback" in self._keys:
            yield from self._item("feedback", _hex(message.goal_id), self._plain("feedback", self._type, message))

    def _statuses(self, message: Any) -> Iterator[Item]:
        found = {_hex(entry.goal_info.goal_id): int(entry.status) for entry in message.status_list}
        for goal, code in self._changed(found):
            yield from self._item("status", goal, {}, None, _word(_ROS2, code))

    # ROS 1

    def _goal1(self, message: Any) -> Iterator[Item]:
        yield from self._of_goal(str(message.goal_id.id), message, self._type, _stamp(message.header.stamp))

    def _cancel1(self, message: Any) -> Iterator[Item]:
        data = message_reader(self._types, self._type, None)(message)
        yield from self._item("cancel", str(message.id), data, None, None, next(self._action.numbers))

    def _feedback1(self, message: Any) -> Iterator[Item]:
        if "feedback" in self._keys:
            data = self._plain("feedback", self._type, message)
            stamp = _stamp(message.header.stamp)
            yield from self._item("feedback", str(message.status.goal_id.id), data, stamp)

    def _result1(self, message: Any) -> Iterator[Item]:
        goal, code, stamp = str(message.status.goal_id.id), int(message.status.status), _stamp(message.header.stamp)
        yield from self._reply1(goal, code, message.status.goal_id, stamp)
        if "result" in self._keys:
            yield from self._item("result", goal, self._plain("result", self._type, message), stamp, _word(_ROS1, code))

    def _statuses1(self, message: Any) -> Iterator[Item]:
        stamp = _stamp(message.header.stamp)
        entries = {str(entry.goal_id.id): entry for entry in message.status_list}
        for goal, code in self._changed({goal: int(entry.status) for goal, entry in entries.items()}):
            yield from self._reply1(goal, code, entries[goal].goal_id, stamp)
            yield from self._item("status", goal, {}, stamp, _word(_ROS1, code))

    def _reply1(self, goal: str, code: int, goal_id: Any, stamp: int | None) -> Iterator[Item]:
        """The first word of a server that says whether it took a goal."""
        if goal in self._action.replied or code in _UNDECIDED:
            return
        self._action.replied.add(goal)
        data = {"accepted": code not in _REFUSED, "stamp": _time(goal_id.stamp)}
        word: Status = "rejected" if code in _REFUSED else "accepted"
        yield from self._item("reply", goal, data, stamp, word, self._action.calls.get(goal))

    # Both

    def _half(self, event: Any) -> Half | None:
        """A request or response with its content, None where another event stands for it. Raises ValueError."""
        if self.topic.calls is None:
            self.topic.calls = Calls(self.topic.events)
        half = self.topic.calls.take(event)
        if half is not None and half.content is None:
            raise ValueError("only metadata was recorded, which does not say what goal it is about")
        return half

    def _goal_of(self, half: Half) -> str:
        """The goal of a response. Raises ValueError where its request is not in the recording."""
        goal = self.topic.goals.pop(half.call, None)
        if goal is None:
            raise ValueError("the request that it answers is not in the recording, and with it the goal")
        return goal

    def _of_goal(self, goal: str, message: Any, outer: str, stamp: int | None) -> Iterator[Item]:
        if "goal" not in self._keys:
            return
        call = self._action.calls[goal] = next(self._action.numbers)
        passed = goal in self._action.passed if self._action.passed_known and "goal" in self._role.asked else None
        for item in self._item("goal", goal, self._plain("goal", outer, message), stamp, None, call):
            yield item._replace(passed=passed)

    def _changed(self, found: dict[str, int]) -> Iterator[tuple[str, int]]:
        """The goals that stand otherwise than in the last array."""
        before, self.topic.standing = self.topic.standing, found
        return ((goal, code) for goal, code in found.items() if before.get(goal) != code)

    def _item(
        self,
        kind: Kind,
        goal: str,
        data: dict[str, Any],
        stamp: int | None = None,
        status: Status | None = None,
        call: int | None = None,
    ) -> Iterator[Item]:
        key = self._keys.get(kind)
        if key is None:
            return
        where = self._plan.spec.by_key[key].stamp
        own = stamp_in(data, where) if where else None
        yield Item(key, own or stamp, data, call, kind in self._role.asked, None, goal, status)

    def _plain(self, kind: Kind, outer: str, message: Any) -> dict[str, Any]:
        """The inner message of one kind, in an outer one of a type, as plain data."""
        if kind not in self._inner:
            node, name = dict(self._types.fielddefs[outer][1])[kind]
            assert node == Nodetype.NAME  # noqa: S101 -- a goal, a result or feedback is a message
            fields = read_fields(self._plan, self._keys[kind])
            self._inner[kind] = message_reader(self._types, str(name), fields, ros1=self._ros1)
        found: dict[str, Any] = self._inner[kind](getattr(message, kind))
        return found

    def _prefix(self, suffix: str) -> str:
        return self._type.removesuffix(suffix)


def _hex(goal_id: Any) -> str:
    return bytes(goal_id.uuid).hex()


def _word(words: tuple[Status, ...], code: int) -> Status:
    return words[code] if 0 <= code < len(words) else "unknown"


def _stamp(stamp: Any) -> int | None:
    """A time of ROS (ns), None where it is not set."""
    return int(stamp.sec) * 10**9 + int(stamp.nanosec) or None


def _time(stamp: Any) -> dict[str, int]:
    return {"sec": int(stamp.sec), "nanosec": int(stamp.nanosec)}
