"""Services: the proxy that clients call, which asks the oracle before and after it calls the service itself."""

from __future__ import annotations

from typing import Any, Iterator, List, Optional

import rospy
from oracle_adapter import TimeSource
from oracle_adapter.calls import call_numbers
from oracle_adapter.fields import not_there
from oracle_adapter.interfaces import Interface, Stream, is_filtered
from oracle_adapter.passing import Passing, TakeBack
from oracle_adapter.unread import Recent, Unreadable
from rospy.impl.tcpros_service import get_service_manager

from oracle_ros1.called import UNCONNECTED, CalledService, Unreached
from oracle_ros1.codec import lacking, reader
from oracle_ros1.definitions import installed_service, lookup_installed, ros1_name
from oracle_ros1.handshakes import MISCALLED
from oracle_ros1.layout import screener
from oracle_ros1.sent import as_sent, sent
from oracle_ros1.shared import Shared
from oracle_ros1.stamps import misplaced, stamp_reader
from oracle_ros1.unserved import UnservedService


class ProxiedService:
    """Serves `proxy`, and calls the service with what may pass; rospy gives each call a thread of its own.

    A call that is denied, or that the service fails, is an error at the client: ROS 1 has errors of services.
    """

    def __init__(self, shared: Shared, service: Interface) -> None:
        """Serve at once. Raises `CodecError`."""
        self._link, self._now, self._graph, self._name = shared.link, shared.now, shared.graph, service.name
        request, response = service.streams["request"], service.streams["response"]
        installed = installed_service(ros1_name(request["type"]))
        self._request = _Side(shared, request, installed._request_class)  # noqa: SLF001 - genpy's own interface
        self._response = _Side(shared, response, installed._response_class)  # noqa: SLF001
        self._type = as_sent(installed, self._request.screen, self._response.screen)
        self.streams = [self._request, self._response]
        self.bypass = ""
        """Why calls did not reach the proxy at the last look."""
        self.doubt = ""
        """That nobody has served it so far, as of the last look."""
        self._calls = call_numbers()
        self._stopped = False
        self._served, self._proxy = shared.names[self._name], shared.names[request["proxy"]]
        self._unserved = UnservedService(shared.graph, self._served, self._proxy)
        self._called = CalledService(self._served, self._type)
        self._unreached = Recent()
        self._service = rospy.Service(self._proxy, self._type, self._serve)

    def look(self) -> str:
        """Why calls do not reach the proxy, can't be read, or lack what the spec reads; empty where all is well."""
        self.bypass = self._graph.not_serving(self._proxy)
        self.doubt = self._unserved.look()
        self._link.lost(sum(side.unreadable.overdue() for side in (self._request, self._response)))
        calls = MISCALLED[rospy.resolve_name(self._proxy)].look(), self._unreached.look()
        return "; ".join(filter(None, (self.bypass, *calls, *self._request.troubles(), *self._response.troubles())))

    def stop(self) -> None:
        """Serve no more: what is not decided on yet goes no further, nor what a client calls on a connection it has.

        That goes to who serves the proxy next.
        """
        self._stopped = True

    def leave(self) -> None:
        """Unregister at the master."""
        self._service.shutdown("the monitor ends")

    def _serve(self, request: Any) -> Any:
        if self._stopped:
            return self._succeeded(request)
        call = next(self._calls)
        take_back = self._judge(self._request, request, call)
        try:
            response = self._called.call(request)
        except Unreached as error:
            take_back()
            if str(error).startswith(UNCONNECTED):
                self._unreached.add(f"a call of {rospy.resolve_name(self._served)} does not come through: {error}")
            raise
        self._judge(self._response, response, call)
        return response

    def _succeeded(self, request: Any) -> Any:
        """The response of what serves the proxy by another spec: whoever keeps a connection calls this one for ever.

        That reads other fields of the request, which is decoded anew for it. Raises `ServiceException` where nothing
        serves the proxy, or by another definition.
        """
        found = get_service_manager().get_service(rospy.resolve_name(self._proxy))
        digest = self._type._md5sum  # noqa: SLF001 - genpy's own interface
        if found is None or found is self._service or found.service_class._md5sum != digest:  # noqa: SLF001
            raise rospy.ServiceException(f"the monitor of {self._name} has ended")
        anew = found.service_class._request_class()  # noqa: SLF001
        return found.handler(anew.deserialize(sent(request).data))

    def _judge(self, side: "_Side", message: Any, call: int) -> TakeBack:
        """Raise `ServiceException`, which is the client's, where this must not pass.

        What is returned reports that it went no further, where that was asked about.
        """
        unread = sent(message).unread
        if unread:
            side.unreadable.add(unread)
            raise rospy.ServiceException(f"the {side.kind} of {self._name} can't be read: {unread}")
        # stamped under the link's lock, so that no clock can exclude it before it is queued
        stamp = (side.stamp and side.stamp(message)) or self._now
        data, lost = side.data(message), side.unreadable.take()
        if side.passing is None:
            self._link.send(self._name, side.kind, stamp, data, call=call, lost=lost)
            return lambda: None
        asked: List[TakeBack] = []
        passed, reason = side.passing.ask_and_wait(
            stamp, data, call, lambda: not self._stopped, lost, before=asked.append
        )
        if not passed:
            raise rospy.ServiceException(f"the oracle denied the {side.kind} of {self._name}: {reason}")
        return asked[0]


class _Side:
    """The requests or the responses of a service."""

    def __init__(self, shared: Shared, stream: Stream, message_type: Any) -> None:
        self.name, self.kind = str(stream["name"]), str(stream["kind"])
        self.passing: Optional[Passing] = None
        self.unreadable = Unreadable()
        if is_filtered(stream):
            self.passing = Passing(shared.link, shared.board, stream, shared.clocks)
        fields, stamps = stream["fields"], filter(None, [stream["stamp"]])
        wanted = None if fields is None else [*fields, *stamps]
        self.screen = screener(message_type, wanted, lookup_installed, shared.frame)
        self._read = reader(message_type, fields, lookup_installed)
        self._blank = " " * ((shared.frame or 0) + 1)
        self.stamp = stamp_reader(message_type, stream["stamp"]) if stream["stamp"] else None
        what = f"the {self.kind} of {stream['type']}"
        unread = not_there(what, lacking(message_type, stream.get("reads") or (), lookup_installed))
        no_time = misplaced(what, stream["stamp"]) if stream["stamp"] and not self.stamp else ""
        self._lacking = "; ".join(filter(None, (unread, no_time)))
        self.time_source: Optional[TimeSource] = "field" if self.stamp else "arrival"
        self.latency: Optional[int] = stream["latency"] if self.stamp else None

    def data(self, message: Any) -> Any:
        """What is read of a message; blanks where no frame holds that."""
        return self._blank if sent(message).is_too_long else self._read(message)

    def troubles(self) -> Iterator[str]:
        """What its type lacks, and why something could not be read; also empty texts."""
        yield self._lacking
        why = self.unreadable.look()
        yield f"a {self.kind} can't be read, and its caller gets an error: {why}" if why else ""
