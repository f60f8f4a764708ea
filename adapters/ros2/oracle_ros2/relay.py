"""One service behind its proxy: calls go on to it when it is there, and each is answered once."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Callable, Iterator

from oracle_adapter.calls import call_numbers
from oracle_adapter.pacing import AT_ONCE
from oracle_adapter.unread import Unreadable
from rclpy.qos import QoSProfile

from oracle_ros2.calltypes import CallTypes
from oracle_ros2.graph import servers
from oracle_ros2.loop import Later, take_requests, tell_unread

if TYPE_CHECKING:
    from oracle_adapter.passing import TakeBack
    from rclpy.node import Node

    from oracle_ros2.loop import Reply

CALLS = QoSProfile(depth=1000)  # of more that come at once the middleware drops the oldest: the usual 10 are few
MOST = 1000
"""Calls without an answer; of more the oldest are given up, as where a service hangs and its clients call again."""
PAUSE = 1.0  # seconds without an answer after which a service gets more: it may work on all at once
UNDERWAY = 0.2  # seconds that an answer may take to its client
DISCOVERY = 2.0  # seconds that a service may take to be discovered, or to come back


@dataclass(eq=False)
class Call:
    """A call of the proxy."""

    number: int
    request: Any
    reply: Reply
    lost: int = 0
    """How many requests before it could not be read; with its response, how many responses."""
    allowed: float = 0.0
    """When it might go to the service (s); 0 while that is not decided."""
    forwarded: bool = False
    """Whether it has gone to the service."""
    servers: frozenset[bytes] = frozenset()
    """Who has got it, where the middleware tells."""
    left: float | None = None
    """Since when none of these is there any more (s)."""
    answered: bool = False
    """Whether the service has answered, and that is decided on at most."""
    answer: Any = None
    """What rclpy waits for the service's answer by."""
    take_back: TakeBack | None = None
    """Reports that it has not passed after all; None where that was not asked about."""

    def may_be_taken_back(self, take_back: TakeBack) -> None:
        """Note what reports that it has not passed after all."""
        self.take_back = take_back

    def given_up(self) -> None:
        """Report that it has not passed after all, where the service has not got it."""
        if self.take_back is not None and not self.forwarded:
            self.take_back()


class Relay:
    """Serves a proxy's name, and calls a service with what its owner lets pass. No call waits for another's answer.

    Of a burst the service gets `AT_ONCE`, and more as it answers, or after a pause without an answer: its queue
    keeps ten calls, and drops the oldest of more.
    """

    def __init__(
        self, node: Node, service_type: Any, served: str, proxy: str,
        on_request: Callable[[Call], None], on_response: Callable[[Call, Any], None], discovery: float = DISCOVERY,
        pause: float = PAUSE,
    ) -> None:  # fmt: skip
        """Serve at once. `on_request` and `on_response` are called in the thread of the callbacks.

        `discovery`: seconds for the service to be discovered at first; once it was, it has `DISCOVERY` to come back.
        `pause`: seconds after which it gets more of a burst, though it answers none.
        """
        self._node, self._on_request, self._on_response = node, on_request, on_response
        self._calls = call_numbers()
        self._lock = threading.Lock()  # guards what follows: decisions come in the link's thread
        self._open: dict[int, Call] = {}  # without an answer
        self._waiting: deque[Call] = deque()  # for the service to be discovered, or to have read those before
        self._ahead, self._since = 0, 0.0  # calls that it has not answered, and since when it has answered none (s)
        self._away: float | None = None  # since when the service has not been there (s)
        self._patience, self._pause = discovery, pause
        self._requests, self._responses = Unreadable(), Unreadable()
        self._ends = False
        self._served = node.resolve_service_name(served)
        self._client = node.create_client(service_type, served, qos_profile=CALLS)
        self._service = node.create_service(
            service_type, proxy, Later(self._serve, self._requests.add), qos_profile=CALLS
        )
        tell_unread(self._client, self._responses.add)
        self._proxy = node.resolve_service_name(proxy)
        self._types = CallTypes(node, self._served, self._proxy)

    @property
    def is_there(self) -> bool:
        """Whether the service is there."""
        return bool(self._client.service_is_ready())

    @property
    def open(self) -> list[Call]:
        """The calls without an answer."""
        with self._lock:
            return list(self._open.values())

    @property
    def unanswered(self) -> list[Call]:
        """Those of them that the service has not answered either."""
        return [call for call in self.open if not call.answered]

    def forward(self, call: Call) -> bool:
        """Call the service once it is there; False where the call has its answer already."""
        with self._lock:
            if call.number not in self._open:
                return False
            call.allowed = time.monotonic()
            self._waiting.append(call)
        self._go_on()
        return True

    def reply(self, call: Call, response: Any) -> bool:
        """Answer a call, unless it was answered."""
        with self._lock:
            found = self._open.pop(call.number, None)
            if found is not None:
                call.reply(response)
        return found is not None

    def send(self, request: Any, then: Callable[[Any], None]) -> Any:
        """Call the service by oneself; `then` gets the response, in the thread of the callbacks.

        Returns what is to be told to `forget`.
        """
        answer = self._client.call_async(request)
        answer.add_done_callback(lambda done: then(done.result()))
        return answer

    def forget(self, answer: Any) -> None:
        """Wait no more for the response to what was sent: a service that hangs never gives one."""
        self._client.remove_pending_request(answer)

    def catch_up(self) -> list[Call]:
        """Go on with calls that wait for the service, and return those that have waited for too long.

        So have those whose server has ended, though there is another one by now.
        To be called often, where callbacks run.
        """
        if not self._open:
            self._away = None
            return []
        now = time.monotonic()
        if self._client.service_is_ready():
            self._away, self._patience = None, DISCOVERY
            with self._lock:
                if now - self._since >= self._pause:
                    self._ahead = 0
            self._go_on()
            return self._left_alone(now)
        self._away = since = self._away or now
        # those that came while it was away have their time too
        return [call for call in self.unanswered if call.allowed and now - max(call.allowed, since) > self._patience]

    def give_up(self) -> list[Call]:
        """Wait for the oldest of more than `MOST` calls no more, and return them."""
        more = len(self._open) - MOST
        oldest = self.open[:more] if more > 0 else []
        for call in oldest:
            if call.answer is not None:
                self._client.remove_pending_request(call.answer)
        return oldest

    def overdue(self, *, requests: bool = True, responses: bool = True) -> int:
        """How many could not be read that no event has told in time, to be told by another one.

        `requests`, `responses`: whether these would be events.
        """
        sides = (self._requests, requests), (self._responses, responses)
        return sum(side.overdue() for side, counts in sides if counts)

    def look(self) -> Iterator[str]:
        """Look at the other nodes again, and return whose calls and answers do not come."""
        if why := self._requests.look():
            yield f"a request of {self._proxy} can't be read, and gets no answer: {why}"
        if why := self._responses.look():
            yield f"a response of {self._served} can't be read, and its caller gets none: {why}"
        yield from self._types.troubles()

    def end(self) -> list[Call]:
        """Let nothing more go on; returns the calls without an answer, with those that came and were not taken yet.

        Of these clients would wait for ever.
        """
        self._ends = True
        take_requests(self._service, CALLS.depth)
        return self.open

    def destroy(self) -> None:
        """Serve no more."""
        self._node.destroy_service(self._service)
        self._node.destroy_client(self._client)

    def _serve(self, request: Any, reply: Reply) -> None:
        call = Call(next(self._calls), request, reply, self._requests.take())
        with self._lock:
            self._open[call.number] = call
        if not self._ends:
            self._on_request(call)

    def _go_on(self) -> None:
        """Call the service for those that wait, as long as it is there and has few to read."""
        while (call := self._next()) is not None:
            self._forward(call)

    def _next(self) -> Call | None:
        with self._lock:
            while self._waiting and self._waiting[0].number not in self._open:
                self._waiting.popleft()
            if not self._waiting or self._ahead >= AT_ONCE or not self._client.service_is_ready():
                return None
            if not self._ahead:
                self._since = time.monotonic()
            self._ahead += 1
            return self._waiting.popleft()

    def _forward(self, call: Call) -> None:
        with self._lock:
            if call.number not in self._open:
                return
            call.forwarded, call.servers = True, servers(self._node, self._served)
            call.answer = answered = self._client.call_async(call.request)

        def take(done: Any) -> None:
            call.answered, call.lost = True, self._responses.take()
            with self._lock:
                self._ahead, self._since = max(0, self._ahead - 1), time.monotonic()
            self._on_response(call, done.result())
            self._go_on()

        answered.add_done_callback(take)

    def _left_alone(self, now: float) -> list[Call]:
        """The calls whose servers have ended for so long that no answer of theirs is on its way."""
        there, unanswered = servers(self._node, self._served), self.unanswered
        for call in unanswered:
            if call.servers:
                call.left = None if call.servers & there else call.left or now
        return [call for call in unanswered if call.left is not None and now - call.left > DISCOVERY]
