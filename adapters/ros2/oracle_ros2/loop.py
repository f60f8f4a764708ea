"""Calls the callbacks of a node's subscriptions, timers, clients and services, one after the other in one thread.

rclpy's executors make a wait set and a task for each message, and wake themselves twice: that takes several times as
long as all that an adapter does with it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Callable, NamedTuple

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation as rcl
from rclpy.logging import get_logger

from oracle_ros2.responses import send

if TYPE_CHECKING:
    from rclpy.node import Node

BURST = 100
"""Messages of one subscription that are taken before others are looked at."""
NONSENSE = 10.0
"""Seconds in which nonsense on a topic of rclpy's own is logged once."""
Reply = Callable[[Any], None]


class Later:
    """A service's callback that gets the request, and a function to reply by, at any time and in any thread."""

    def __init__(self, take: Callable[[Any, Reply], None], unread: Callable[[str], None]) -> None:
        """`unread` is told why a request can't be read; who sent it gets no answer."""
        self.take, self.unread = take, unread

    def __call__(self, _request: Any, _response: Any) -> Any:
        """Refuse: an executor of rclpy's sends what is returned, at once."""
        raise TypeError("a service that replies later is served by a Loop, and by no executor of rclpy")


def tell_unread(client: Any, unread: Callable[[str], None]) -> None:
    """Have a function of a client's told why a response can't be read; whose it is can't be known."""
    client.oracle_unread = unread


def take_requests(service: Any, most: int) -> None:
    """Take the requests of a service that have come by now, and of more than `most` only as many."""
    take = _service(service)
    for _ in range(most):
        if not take():
            break


class Loop:
    """One node's callbacks. Only the thread that calls `turn` makes and destroys what it waits for."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._known: list[Any] = []
        self._waiting: Any = None
        self._entities: list[_Entity] = []

    def turn(self) -> None:
        """Wait until something is there, and take it; raises `ExternalShutdownException` where ROS was shut down."""
        node = self._node
        known = [*node.timers, *node.subscriptions, *node.clients, *node.services]
        if known != self._known:
            self._prepare(known)
        waiting = self._waiting
        waiting.clear_entities()
        places = [entity.add(entity.handle) for entity in self._entities]
        waiting.wait(-1)
        if not node.context.ok():
            raise ExternalShutdownException
        for entity, place in zip(self._entities, places, strict=True):
            # checked first, not caught: an error of a callback must not be taken for this
            if waiting.is_ready(entity.kind, place) and _is_there(entity.handle):
                entity.take()

    def _prepare(self, known: list[Any]) -> None:
        node = self._node
        kinds = {"timer": node.timers, "subscription": node.subscriptions, "client": node.clients}
        some = {kind: list(of_kind) for kind, of_kind in {**kinds, "service": node.services}.items()}
        timers, subscriptions, clients, services = (len(of_kind) for of_kind in some.values())
        waiting = rcl.WaitSet(subscriptions, 0, timers, clients, services, 0, node.context.handle)
        self._entities = [
            _Entity(kind, one.handle, getattr(waiting, f"add_{kind}"), _TAKES[kind](one))
            for kind, of_kind in some.items()
            for one in of_kind
        ]
        self._known, self._waiting = known, waiting


def _is_there(handle: Any) -> bool:
    """Whether something was not destroyed by an earlier callback."""
    try:
        with handle:
            return True
    except InvalidHandle:
        return False


class _Entity(NamedTuple):
    kind: str
    handle: Any
    add: Callable[[Any], int]
    take: Callable[[], object]


def _timer(timer: Any) -> Callable[[], None]:
    handle = timer.handle

    def take() -> None:
        with handle:
            if not handle.is_timer_ready():
                return
            handle.call_timer()
        timer.callback()

    return take


def _subscription(subscription: Any) -> Callable[[], None]:
    handle, message_type, callback = subscription.handle, subscription.msg_type, subscription.callback
    raw = subscription.raw
    parts = 2 if raw else 1  # only those of `MatchedSubscription` are raw; rclpy's own, as that of /clock, are not

    def take() -> None:
        with handle:
            for _ in range(BURST):
                taken = handle.take_message(message_type, raw)
                if taken is None:
                    return
                callback(*taken[:parts])

    return take if raw else _guarded(take, subscription.topic_name)


def _guarded(take: Callable[[], None], topic: str) -> Callable[[], None]:
    """What is rclpy's own, as its clock, which raises where another node says nonsense: that must end nothing here."""

    def guarded() -> None:
        try:
            take()
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            get_logger("oracle").error(f"{topic}: a message can't be read: {error}", throttle_duration_sec=NONSENSE)

    return guarded


def _client(client: Any) -> Callable[[], None]:
    handle, response_type = client.handle, client.srv_type.Response

    def take() -> None:
        try:
            with handle:
                header, response = handle.take_response(response_type)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            unread = getattr(client, "oracle_unread", None)
            if unread is not None:
                unread(str(error) or type(error).__name__)
            return
        if header is None:
            return
        try:
            waiting = client.get_pending_request(header.request_id.sequence_number)
        except KeyError:  # no caller waits for it any more
            return
        waiting.set_result(response)

    return take


def _service(service: Any) -> Callable[[], bool]:
    handle, kind, callback = service.handle, service.srv_type, service.callback

    def take() -> bool:
        """Take one request; False where there is none."""
        try:
            with handle:
                request, header = handle.service_take_request(kind.Request)
        except Exception as error:  # noqa: BLE001 - whatever another node sends
            if isinstance(callback, Later):
                callback.unread(str(error) or type(error).__name__)
            return True
        if header is None:
            return False

        def reply(response: Any) -> None:
            send(service, response, header)

        if isinstance(callback, Later):
            callback.take(request, reply)
        else:
            reply(callback(request, kind.Response()))
        return True

    return take


_TAKES: dict[str, Callable[[Any], Callable[[], object]]] = {
    "timer": _timer,
    "subscription": _subscription,
    "client": _client,
    "service": _service,
}
