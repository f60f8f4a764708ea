"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

import itertools
import time
from typing import TYPE_CHECKING, Any, Mapping

from oracle_adapter import Answer, Board, Link
from oracle_adapter.passing import Passing
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.task import Future

from oracle_ros2.codec import load_type, reader, write
from oracle_ros2.stamps import stamp_reader, time_of

if TYPE_CHECKING:
    from oracle_adapter import ClockStamp, Names
    from rclpy.node import Node

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
        self._group = ReentrantCallbackGroup()
        self._client = node.create_client(self._type, names[self.name], callback_group=self._group)
        proxy = names[request["proxy"]]
        self._service = node.create_service(self._type, proxy, self._serve, callback_group=self._group)

    def stop(self) -> None:
        """Serve no more."""
        self._node.destroy_service(self._service)
        self._node.destroy_client(self._client)

    async def _serve(self, request: Any, response: Any) -> Any:
        call = next(self._calls)
        if not await self._may_pass(self._request, request, call):
            return write(response, self._denied)
        if not self._client.service_is_ready() and not await self._appears():
            self._board.error(f"{self.name} is not there: call {call} is answered by denied_response")
            return write(response, self._denied)
        answer = await self._client.call_async(request)
        if not await self._may_pass(self._response, answer, call):
            return write(response, self._denied)
        return answer

    def _now(self) -> list[ClockStamp]:
        now = self._time()
        return [(self.name, side.kind, now) for side in (self._request, self._response) if side.stamped_here]

    async def _appears(self) -> bool:
        """Whether the service is there soon: one that has just been started may not have been discovered yet."""
        settled: Future[bool] = Future(executor=self._node.executor)
        end = time.monotonic() + DISCOVERY

        def look() -> None:
            ready = self._client.service_is_ready()
            if not settled.done() and (ready or time.monotonic() > end):
                settled.set_result(ready)

        clock = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self._node.create_timer(0.02, look, self._group, clock)
        ready = await settled
        self._node.destroy_timer(timer)
        return ready

    async def _may_pass(self, side: _Side, message: Any, call: int) -> bool:
        # stamped under the link's lock, so that no clock can say that nothing older will come
        stamp = side.stamp(message) or self._time
        data = side.read(message)
        if side.passing is None:
            self._link.send(self.name, side.kind, stamp, data, call=call)
            return True
        asked = side.passing.ask(stamp, data, call=call)
        self._link.clock(self._now)  # or the decision would wait for the monitor's next one
        executor = self._node.executor
        settled: Future[Answer] = Future(executor=executor)

        def settle(done: Any) -> None:  # in the link's thread
            settled.set_result(done.result())
            executor.wake()

        asked.add_done_callback(settle)
        passed, _reason = side.passing.settle(await settled, call)
        return passed


class _Side:
    """The requests or the responses of a service."""

    def __init__(self, link: Link, board: Board, stream: Mapping[str, Any], message_type: Any) -> None:
        self.kind: str = stream["kind"]
        self.passing = Passing(link, board, stream) if stream["action"] == "filter" else None
        self.read = reader(message_type, stream["fields"])
        self.stamped_here = not stream["stamp"]
        self.stamp = (stream["stamp"] and stamp_reader(message_type, stream["stamp"])) or (lambda _: None)
