"""Service events as requests and responses: one of each a call, from the server's side where the bag has that."""

from __future__ import annotations

from collections.abc import Collection
from itertools import count
from typing import Any, NamedTuple

from oracle_server.core.kinds import Kind

_REQUEST_SENT, _REQUEST_RECEIVED, _RESPONSE_SENT, _RESPONSE_RECEIVED = range(4)
RESPONSES = frozenset({_RESPONSE_SENT, _RESPONSE_RECEIVED})


class Half(NamedTuple):
    """A request or a response.

    `content` is the message as it was decoded, None where only its metadata was recorded; `stamp` is in nanoseconds;
    `call` is equal for a request and its response.
    """

    kind: Kind
    content: Any
    stamp: int
    call: int


def kind_of(event: Any) -> Kind:
    """Whether an event is of a request or of a response."""
    return "response" if event.info.event_type in RESPONSES else "request"


class Calls:
    """Takes one event a request and one a response of a service's calls."""

    def __init__(self, kinds: Collection[int]) -> None:
        """`kinds` are the types of all events that are recorded of the service."""
        request = _REQUEST_RECEIVED if _REQUEST_RECEIVED in kinds else _REQUEST_SENT
        response = _RESPONSE_SENT if _RESPONSE_SENT in kinds else _RESPONSE_RECEIVED
        self._taken = {request, response}
        self._same_side = (request, response) in (
            (_REQUEST_RECEIVED, _RESPONSE_SENT),
            (_REQUEST_SENT, _RESPONSE_RECEIVED),
        )
        self._numbers = count(1)
        self._calls: dict[tuple[bytes, int], int] = {}

    def take(self, event: Any) -> Half | None:
        """The request or response of an event, None where another event of the same stands for it."""
        info = event.info
        if info.event_type not in self._taken:
            return None
        kind = kind_of(event)
        client = bytes(info.client_gid) if self._same_side else b""  # the sides may name a client differently
        key = client, int(info.sequence_number)
        if kind == "request":
            call = self._calls[key] = next(self._numbers)
        else:
            call = self._calls.pop(key, 0) or next(self._numbers)
        contents = event.request if kind == "request" else event.response
        stamp = int(info.stamp.sec) * 10**9 + int(info.stamp.nanosec)
        return Half(kind, contents[0] if len(contents) else None, stamp, call)
