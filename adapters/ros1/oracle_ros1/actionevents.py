"""The events of an action: what its clients and its server say, and what its server's statuses tell."""

from __future__ import annotations

import threading
from collections import OrderedDict, defaultdict
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

import rospy
from oracle_adapter import Stamp
from oracle_adapter.calls import call_numbers
from oracle_adapter.interfaces import Interface
from oracle_adapter.kept import Beginning
from oracle_adapter.unread import Unread

from oracle_ros1.actionmessages import ActionStream, ActionTypes, text_of
from oracle_ros1.actionstatus import accepted, word
from oracle_ros1.codec import CodecError
from oracle_ros1.headers import header_of, headers, node_of
from oracle_ros1.shared import Shared
from oracle_ros1.statusarray import StatusArray
from oracle_ros1.unheard import Unheard

KEPT = 10_000
"""The most goals of which something is still to come; the oldest are forgotten."""
CONNECTED_WITHIN = 10**9
"""The time (ns) that it may take to hear a server: one that is there as this begins says again how goals stand."""


class Event(NamedTuple):
    """An event, as the link takes it."""

    stamp: Stamp
    data: Any
    more: Mapping[str, Any]


class ActionEvents:
    """Makes events of an action's messages; reports replies and statuses, which nobody asks about."""

    def __init__(self, shared: Shared, action: Interface, *, proxied: bool) -> None:
        """Raises `CodecError` where the action's type is not installed."""
        described = list(action.streams.values())
        self.types = ActionTypes(described[0]["type"], action.streams, shared.frame)
        self.name = action.name
        made = [ActionStream(shared, stream, self.types, proxied=proxied) for stream in described]
        self.streams: Dict[str, ActionStream] = {stream.kind: stream for stream in made}
        self.numbers = call_numbers()
        """Number what clients ask for, in the order in which it comes."""
        self._link, self._unheard = shared.link, Unheard(shared.graph)
        self._beginning = Beginning(shared.now)
        self._replying = threading.Lock()  # guards what follows
        self._unanswered: "OrderedDict[str, int]" = OrderedDict()  # goals without a reply, with their numbers
        self._lost: Dict[str, Unread] = defaultdict(Unread)
        self._unread: Dict[str, str] = {}

    def reads(self, kind: str) -> bool:
        """Whether messages of a topic tell anything that the spec wants to know."""
        return kind in self.streams or ("reply" in self.streams and kind in ("status", "feedback", "result"))

    @property
    def wants_statuses(self) -> bool:
        """Whether the next array of statuses tells anything that the spec wants to know."""
        return "status" in self.streams or bool(self._unanswered)

    def decoded(self, kind: str, message: rospy.AnyMsg) -> Any:
        """What came on one of the topics; None, and told, where it can't be read."""
        try:
            return self.types.decoded(kind, message)
        except CodecError as error:
            with self._replying:
                self._lost[kind].add()
                self._unread[node_of(header_of(message))] = str(error)
            return None

    def event(
        self,
        kind: str,
        message: Any,
        found: Any,
        goal_id: str,
        *,
        call: Optional[int] = None,
        code: Optional[int] = None,
    ) -> Optional[Event]:
        """The event of a message, whose inside is `found`; None where the spec has no events of the kind."""
        stream = self.streams.get(kind)
        if stream is None:
            return None
        more: Dict[str, Any] = {"goal_id": text_of(goal_id), "call": call}
        if code is not None:
            more["status"] = word(code)
        if kind in self._lost:
            with self._replying:
                more["lost"] = self._lost[kind].take()
        return Event(stream.stamp(message, found), stream.data(message, found), more)

    def send(self, kind: str, event: Event) -> None:
        """Report an event that nobody is asked about."""
        self._link.send(self.name, kind, event.stamp, event.data, **event.more)

    def answer(self, kind: str, found: Any) -> None:
        """Report feedback or a result, and the reply that it tells; nothing where it could not be read."""
        if found is None:
            return
        said = found.status
        self.answered(said.goal_id.id, said.status, found.header)
        code = said.status if kind == "result" else None
        event = self.event(kind, found, getattr(found, kind), said.goal_id.id, code=code)
        if event is not None:
            self.send(kind, event)

    def expect_reply(self, goal_id: str, call: int) -> None:
        """A goal is on its way to the server."""
        if "reply" in self.streams:
            with self._replying:
                self._unanswered[goal_id] = call
                if len(self._unanswered) > KEPT:
                    self._unanswered.popitem(last=False)

    def answered(self, goal_id: str, code: int, header: Any) -> None:
        """Report the reply to a goal with the first status that tells it, wherever this stands."""
        verdict = accepted(code)
        if verdict is None or goal_id not in self._unanswered:
            return
        with self._replying:  # until it is queued: whatever else the server says of the goal comes behind it
            call = self._unanswered.pop(goal_id, None)
            if call is None:
                return
            stamp = {"sec": header.stamp.secs, "nanosec": header.stamp.nsecs}
            stream = self.streams["reply"]
            data = stream.data(None, {"accepted": verdict, "stamp": stamp})
            said = "accepted" if verdict else "rejected"
            self._link.send(
                self.name, "reply", stream.stamp(None, None), data,
                goal_id=text_of(goal_id), call=call, status=said,
            )  # fmt: skip

    def standing(self, array: StatusArray) -> Dict[str, int]:
        """How goals of before stood as this began, where that is the first array of a server, which keeps its last."""
        latched, is_after = header_of(array.message).get("latching") == "1", self._beginning.is_after
        if not latched or not is_after(array.header.stamp.to_nsec() - CONNECTED_WITHIN):
            return {}
        return {one.goal_id.id: one.code for one in array.entries if is_after(one.goal_id.stamp.to_nsec())}

    def changed(self, array: Any, changes: Iterable[Tuple[str, int]]) -> None:
        """Report the replies and the statuses that an array brings."""
        for goal_id, code in changes:
            self.answered(goal_id, code, array.header)
            event = self.event("status", array, {}, goal_id, code=code)
            if event is not None:
                self.send("status", event)

    def troubles(self, subscribers: Mapping[str, rospy.Subscriber]) -> List[str]:
        """What is wrong with what is published, and with what the spec reads."""
        found: Dict[str, None] = {stream.trouble: None for stream in self.streams.values() if stream.trouble}
        nodes = set()
        for kind, subscriber in subscribers.items():
            for header in headers(subscriber):
                nodes.add(node_of(header))
                try:
                    self.types.check(kind, header)
                except CodecError as error:
                    found[str(error)] = None
        with self._replying:
            self._unread = {node: why for node, why in self._unread.items() if node in nodes}
            found.update(dict.fromkeys(self._unread.values()))
            overdue = sum(lost.overdue() for lost in self._lost.values())
        self._link.lost(overdue)
        found.update(dict.fromkeys(self._unheard.look(subscribers.values())))
        return list(found)
