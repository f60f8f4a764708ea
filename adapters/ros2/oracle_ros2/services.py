"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Mapping, Sequence

from oracle_adapter.interfaces import is_filtered

from oracle_ros2.circles import call_circle
from oracle_ros2.codec import load_type, write
from oracle_ros2.graph import past_proxy
from oracle_ros2.relay import MOST, UNDERWAY, Relay
from oracle_ros2.sides import Side
from oracle_ros2.unserved import UnservedService

if TYPE_CHECKING:
    from oracle_adapter.interfaces import Interface

    from oracle_ros2.relay import Call
    from oracle_ros2.shared import Shared


class ProxiedService:
    """Serves `proxy`, and calls the service with what may pass. Calls wait for nothing but their own answers.

    Of many that may go at once, as after an outage of the oracle, the service gets as many at a time as it keeps.
    """

    received = 0
    """Calls do not show whether the middleware delivers: they are too rare."""

    def __init__(self, shared: Shared, service: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        self._node, self._link, self._board = shared.node, shared.link, shared.board
        self.name = service.name
        request, response = service.streams["request"], service.streams["response"]
        self._type = load_type(request["type"])
        self._denied: Mapping[str, Any] = request.get("denied_response") or {}
        write(self._type.Response(), self._denied)
        if is_filtered(request) and not self._denied:
            shared.node.get_logger().warning(
                f"a denied call of {self.name} is answered by the defaults of its type, which a client may take for a "
                "success; the spec can give another one by `denied_response`"
            )
        self._request = Side(shared, request, self._type.Request)
        self._response = Side(shared, response, self._type.Response)
        self.streams = [self._request, self._response]
        self.bypass = ""
        """Who can call without the proxy, or serves in its place, as of the last look."""
        self.doubt = ""
        """That nobody serves it, as of the last look."""
        self._served, self._proxy = shared.names[self.name], shared.names[request["proxy"]]
        self._circle = call_circle(shared.node, self._served, self._proxy)
        self._unserved = UnservedService(shared.node, self._served, request["type"])
        self._relay = Relay(shared.node, self._type, self._served, self._proxy, self._ask, self._answer)

    def stop(self) -> None:
        """Serve no more; calls without an answer get `denied_response`, whatever is decided on them later."""
        left = self._relay.end()
        self._give_up(left, f"the monitor of {self.name} ends")
        if left:
            time.sleep(UNDERWAY)  # answers that have not arrived yet go with the service
        self._relay.destroy()

    def look(self) -> str:
        """Look at the other nodes again, and return what is wrong."""
        self.doubt = self._unserved.look()
        self._link.lost(self._relay.overdue())
        self._circle.look()
        past = past_proxy(self._node, (self._served, self._proxy))
        self.bypass = "; ".join(filter(None, (past, self._circle.text)))
        troubles = (self.bypass, *self._relay.look(), self._request.trouble, self._response.trouble)
        return "; ".join(trouble for trouble in troubles if trouble)

    def catch_up(self) -> None:
        """Go on with calls that wait for the service; to be called often, where callbacks run."""
        self._give_up(self._relay.catch_up(), f"{self.name} is not there")
        self._give_up(self._relay.give_up(), f"{self.name} has not answered it, nor {MOST} that came later")

    # The steps of a call, in the thread of the callbacks; in the link's after a decision.

    def _ask(self, call: Call) -> None:
        def give() -> bool:
            if self._circle.text:
                self._give_up([call], self._circle.text)
                return False
            return self._relay.forward(call)

        self._request.judge(call.request, give, lambda: self._deny(call), call.number, lost=call.lost,
                            before=call.may_be_taken_back)  # fmt: skip

    def _answer(self, call: Call, response: Any) -> None:
        reply = self._relay.reply
        give, refuse = lambda: reply(call, response), lambda: self._deny(call)
        self._response.judge(response, give, refuse, call.number, lost=call.lost)

    def _deny(self, call: Call) -> bool:
        return self._relay.reply(call, write(self._type.Response(), self._denied))

    def _give_up(self, calls: Sequence[Call], why: str) -> None:
        for call in calls:
            if self._deny(call):
                call.given_up()
                self._board.error(f"{why}: call {call.number} is answered by denied_response")
