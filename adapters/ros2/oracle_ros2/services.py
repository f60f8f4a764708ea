"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

import itertools
import time
from collections import deque
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Mapping

from oracle_adapter import Board, Link
from oracle_adapter.passing import Passing
from rclpy.exceptions import InvalidHandle

from oracle_ros2.codec import load_type, reader, write
from oracle_ros2.loop import Later
from oracle_ros2.stamps import stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import Answer, ClockStamp, Names
    from rclpy.node import Node

    from oracle_ros2.loop import Reply

DISCOVERY = 2.0  # seconds that a service may take to be discovered


class ProxiedService:
    """Serves `proxy`, and calls the service with what may pass. Calls wait for nothing but their own answers."""

    def __init__(
        self,
        node: Node,
        link: Link,
        board: Board,
        names: Names,
        request: Mapping[str, Any],
        response: Mapping[str, Any],
    ) -> None:
        """Serve at once; `request` and `response` are the service's streams. Raises `CodecError`."""
        self._node, self._link, self._board, self._time = node, link, board, time_of(node)
        self.name: str = request["name"]
        self._type = load_type(request["type"])
        self._denied: Mapping[str, Any] = request.get("denied_response") or {}
        write(self._type.Response(), self._denied)
        if request["action"] == "filter" and not self._denied:
            node.get_logger().warning(
                f"a denied call of {self.name} is answered by the defaults of its type, which a client may take for a "
                "success; the spec can say otherwise by `denied_response`"
            )
        self._request = _Side(link, board, request, self._type.Request)
        self._response = _Side(link, board, response, self._type.Response)
        self._calls = itertools.count(1)
        self._early: deque[tuple[float, _Call]] = deque()  # when each gives up (s), and the call
        self._client = node.create_client(self._type, names[self.name])
        self._service = node.create_service(self._type, names[request["proxy"]], Later(self._serve))

    def stop(self) -> None:
        """Serve no more."""
        self._node.destroy_service(self._service)
        self._node.destroy_client(self._client)

    def tend(self) -> None:
        """Go on with calls that wait for the service to be discovered; to be called often, where callbacks run."""
        for _ in range(len(self._early)):
            patience, call = self._early.popleft()
            if self._client.service_is_ready():
                self._forward(call)
            elif time.monotonic() < patience:
                self._early.append((patience, call))
            else:
                self._board.error(f"{self.name} is not there: call {call.number} is answered by denied_response")
                self._deny(call)

    # The steps of a call, in the thread of the callbacks; in the link's after a decision.

    def _serve(self, request: Any, reply: Reply) -> None:
        call = _Call(next(self._calls), request, reply)
        self._judge(self._request, request, call, lambda: self._forward_when_there(call))

    def _forward_when_there(self, call: _Call) -> None:
        if self._client.service_is_ready():
            self._forward(call)
        else:
            self._early.append((time.monotonic() + DISCOVERY, call))

    def _forward(self, call: _Call) -> None:
        with suppress(InvalidHandle):  # stopped meanwhile
            self._client.call_async(call.request).add_done_callback(lambda done: self._answer(call, done.result()))

    def _answer(self, call: _Call, response: Any) -> None:
        self._judge(self._response, response, call, lambda: call.reply(response))

    def _deny(self, call: _Call) -> None:
        call.reply(write(self._type.Response(), self._denied))

    def _judge(self, side: _Side, message: Any, call: _Call, then: Callable[[], None]) -> None:
        # stamped under the link's lock, so that no clock can say that nothing older will come
        stamp = side.stamp(message) or self._time
        data = side.read(message)
        passing = side.passing
        if passing is None:
            self._link.send(self.name, side.kind, stamp, data, call=call.number)
            then()
            return

        def settle(answer: Answer) -> None:
            passed, _reason = passing.settle(answer, call.number)
            if passed:
                then()
            else:
                self._deny(call)

        passing.ask(stamp, data, settle, call=call.number)
        self._link.clock(self._now)  # or the decision would wait for the monitor's next one

    def _now(self) -> list[ClockStamp]:
        now = self._time()
        return [(self.name, side.kind, now) for side in (self._request, self._response) if side.stamped_here]


@dataclass(frozen=True)
class _Call:
    number: int
    request: Any
    reply: Reply


class _Side:
    """The requests or the responses of a service."""

    def __init__(self, link: Link, board: Board, stream: Mapping[str, Any], message_type: Any) -> None:
        self.kind: str = stream["kind"]
        self.passing = Passing(link, board, stream) if stream["action"] == "filter" else None
        self.read = reader(message_type, stream["fields"])
        self.stamped_here = not stream["stamp"]
        self.stamp = (stream["stamp"] and stamp_reader(message_type, stream["stamp"])) or (lambda _: None)
