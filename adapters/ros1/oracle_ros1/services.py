"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

import itertools
from typing import Any, List, Mapping

import rospy
from oracle_adapter import Board, ClockStamp, Link, Names
from oracle_adapter.passing import Passing

from oracle_ros1.codec import reader
from oracle_ros1.definitions import installed_service, lookup_installed, ros1_name
from oracle_ros1.stamps import Now, stamp_reader


class ProxiedService:
    """Serves `proxy`, and calls the service with what may pass; rospy gives each call a thread of its own.

    A call that is denied, or that the service fails, is an error at the client: ROS 1 has errors of services.
    """

    def __init__(
        self, link: Link, board: Board, names: Names, request: Mapping[str, Any], response: Mapping[str, Any], now: Now
    ) -> None:
        """Serve at once; `request` and `response` are the service's streams. Raises `CodecError`."""
        self._link, self._now, self.name = link, now, str(request["name"])
        self._type = installed_service(ros1_name(request["type"]))
        self._request = _Side(link, board, request, self._type._request_class)  # noqa: SLF001 - genpy's own interface
        self._response = _Side(link, board, response, self._type._response_class)  # noqa: SLF001
        self._calls = itertools.count(1)
        self._served, self.proxy = names[self.name], names[request["proxy"]]
        self._service = rospy.Service(self.proxy, self._type, self._serve)

    @property
    def sides(self) -> "List[_Side]":
        """The requests and the responses."""
        return [self._request, self._response]

    def stop(self) -> None:
        """Serve no more."""
        self._service.shutdown("the monitor ends")

    def _serve(self, request: Any) -> Any:
        call = next(self._calls)
        self._judge(self._request, request, call)
        response = rospy.ServiceProxy(self._served, self._type)(request)
        self._judge(self._response, response, call)
        return response

    def _judge(self, side: "_Side", message: Any, call: int) -> None:
        """Raise `ServiceException`, which is the client's, where this must not pass."""
        # stamped under the link's lock, so that no clock can say that nothing older will come
        stamp = (side.stamp and side.stamp(message)) or self._now
        data = side.read(message)
        if not side.filtered:
            self._link.send(self.name, side.kind, stamp, data, call=call)
            return
        # the clocks go at once, or the decision would wait for the monitor's next ones
        passed, reason = side.passing.ask_and_wait(stamp, data, call, lambda: self._link.clock(self._stamps))
        if not passed:
            raise rospy.ServiceException(f"the oracle denied the {side.kind} of {self.name}: {reason}")

    def _stamps(self) -> List[ClockStamp]:
        now = self._now()
        return [(self.name, side.kind, now) for side in self.sides if side.stamp is None and now is not None]


class _Side:
    """The requests or the responses of a service."""

    def __init__(self, link: Link, board: Board, stream: Mapping[str, Any], message_type: Any) -> None:
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.latency: int = stream["latency"]
        self.filtered = stream["action"] == "filter"
        if self.filtered:
            self.passing = Passing(link, board, stream)
        self.read = reader(message_type, stream["fields"], lookup_installed)
        self.stamp = stamp_reader(message_type, stream["stamp"]) if stream["stamp"] else None
