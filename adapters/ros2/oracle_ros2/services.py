"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

import itertools
import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Mapping, Sequence

from oracle_adapter.fields import not_there
from oracle_adapter.interfaces import is_filtered
from oracle_adapter.passing import Passing
from rclpy.qos import QoSProfile

from oracle_ros2.codec import lacking, load_type, reader, write
from oracle_ros2.graph import past_proxy
from oracle_ros2.loop import Later
from oracle_ros2.stamps import stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import Answer, TimeSource
    from oracle_adapter.interfaces import Interface, Stream

    from oracle_ros2.loop import Reply
    from oracle_ros2.shared import Shared

CALLS = QoSProfile(depth=1000)  # of more that come at once the middleware drops the oldest: the usual 10 are few
UNDERWAY = 0.2  # seconds that an answer may take to its client
DISCOVERY = 2.0  # seconds that a service may take to be discovered, or to come back


class ProxiedService:
    """Serves `proxy`, and calls the service with what may pass. Calls wait for nothing but their own answers."""

    received = 0
    """Calls do not show whether the middleware delivers: they are too rare."""

    def __init__(self, shared: Shared, service: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        node = self._node = shared.node
        self._link, self._board, self._time = shared.link, shared.board, time_of(node)
        self.name = service.name
        request, response = service.streams["request"], service.streams["response"]
        self._type = load_type(request["type"])
        self._denied: Mapping[str, Any] = request.get("denied_response") or {}
        write(self._type.Response(), self._denied)
        if is_filtered(request) and not self._denied:
            node.get_logger().warning(
                f"a denied call of {self.name} is answered by the defaults of its type, which a client may take for a "
                "success; the spec can give another one by `denied_response`"
            )
        self._request = _Side(shared, request, self._type.Request)
        self._response = _Side(shared, response, self._type.Response)
        self.streams = [self._request, self._response]
        self.bypass = ""
        """Who can call without the proxy, or serves in its place, as of the last look."""
        self._calls = itertools.count(1)
        self._lock = threading.Lock()  # guards what follows: decisions come in the link's thread
        self._open: dict[int, _Call] = {}  # without an answer
        self._early: deque[_Call] = deque()  # that wait for the service to be discovered
        self._away: float | None = None  # since when the service has not been there (s)
        self._served, self._proxy = shared.names[self.name], shared.names[request["proxy"]]
        self._client = node.create_client(self._type, self._served, qos_profile=CALLS)
        self._service = node.create_service(self._type, self._proxy, Later(self._serve), qos_profile=CALLS)

    def stop(self) -> None:
        """Serve no more; calls without an answer get `denied_response`, whatever is decided on them later."""
        with self._lock:
            left = list(self._open.values())
        self._give_up(left, f"the monitor of {self.name} ends")
        if left:
            time.sleep(UNDERWAY)  # answers that have not arrived yet go with the service
        self._node.destroy_service(self._service)
        self._node.destroy_client(self._client)

    def look(self) -> str:
        """Who can call the service without the proxy, or serves in its place, and what its type lacks; else empty."""
        self.bypass = past_proxy(self._node, self._served, self._proxy)
        troubles = (self.bypass, self._request.lacking, self._response.lacking)
        return "; ".join(trouble for trouble in troubles if trouble)

    def catch_up(self) -> None:
        """Go on with calls that wait for the service; to be called often, where callbacks run."""
        if not self._open:
            self._away = None
            return
        now = time.monotonic()
        if self._client.service_is_ready():
            self._away = None
            self._forward_early()
            return
        self._away = since = self._away or now
        with self._lock:  # those that came while it was away have their time too
            allowed = [call for call in self._open.values() if call.allowed]
        left = [call for call in allowed if now - max(call.allowed, since) > DISCOVERY]
        self._give_up(left, f"{self.name} is not there")

    # The steps of a call, in the thread of the callbacks; in the link's after a decision.

    def _serve(self, request: Any, reply: Reply) -> None:
        call = _Call(next(self._calls), request, reply)
        with self._lock:
            self._open[call.number] = call
        self._judge(self._request, request, call, self._forward_when_there)

    def _forward_when_there(self, call: _Call) -> bool:
        with self._lock:
            if call.number not in self._open:
                return False
            call.allowed = time.monotonic()
            ready = self._client.service_is_ready()
            if not ready:
                self._early.append(call)
        if ready:
            self._forward(call)
        return True

    def _forward_early(self) -> None:
        while self._early:
            self._forward(self._early.popleft())

    def _forward(self, call: _Call) -> None:
        with self._lock:
            if call.number not in self._open:
                return
            answered = self._client.call_async(call.request)
        answered.add_done_callback(lambda done: self._answer(call, done.result()))

    def _answer(self, call: _Call, response: Any) -> None:
        self._judge(self._response, response, call, lambda _: self._reply(call, response))

    def _reply(self, call: _Call, response: Any) -> bool:
        """Answer a call, unless it was answered."""
        with self._lock:
            found = self._open.pop(call.number, None)
            if found is not None:
                call.reply(response)
        return found is not None

    def _deny(self, call: _Call) -> bool:
        return self._reply(call, write(self._type.Response(), self._denied))

    def _give_up(self, calls: Sequence[_Call], why: str) -> None:
        for call in calls:
            if self._deny(call):
                self._board.error(f"{why}: call {call.number} is answered by denied_response")

    def _judge(self, side: _Side, message: Any, call: _Call, give: Callable[[_Call], bool]) -> None:
        # stamped under the link's lock, so that no clock can exclude it before it is queued
        stamp = side.stamp(message) or self._time
        data = side.read(message)
        passing = side.passing
        if passing is None:
            self._link.send(self.name, side.kind, stamp, data, call=call.number)
            give(call)
            return

        def settle(answer: Answer) -> None:
            passed, _reason = passing.settle(answer, give, call, call.number)
            if not passed:
                self._deny(call)

        passing.ask(stamp, data, settle, call=call.number)


@dataclass(eq=False)
class _Call:
    number: int
    request: Any
    reply: Reply
    allowed: float = 0.0
    """When it might go to the service (s); 0 while that is not decided."""


class _Side:
    """The requests or the responses of a service."""

    def __init__(self, shared: Shared, stream: Stream, message_type: Any) -> None:
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.passing: Passing | None = None
        if is_filtered(stream):
            self.passing = Passing(shared.link, shared.board, stream, shared.clocks)
        self.lacking = not_there(
            f"the {self.kind} of {stream['type']}", lacking(message_type, stream.get("reads") or ())
        )
        self.read = reader(message_type, stream["fields"])
        self.latency: int | None = stream["latency"] if stream["stamp"] else None
        self.time_source: TimeSource = "field" if stream["stamp"] else "arrival"
        self.stamp = (stream["stamp"] and stamp_reader(message_type, stream["stamp"])) or (lambda _: None)
