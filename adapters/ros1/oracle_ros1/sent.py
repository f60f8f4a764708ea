"""The messages of a service as they were sent: passed on byte for byte, and decoded as far as anything reads them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from oracle_ros1.layout import Screen


@dataclass(frozen=True)
class Sent:
    """What is known of a message beside its fields."""

    data: bytes
    unread: str = ""
    """Why it can't be read; else empty."""
    is_too_long: bool = False
    """Whether it has a list that is read and that no frame holds, which was not decoded."""


def as_sent(service_type: Any, request: Screen, response: Screen) -> Any:
    """A service's type whose messages are passed on as they came, whatever the screens leave of them to be decoded.

    Of an exception as one is decoded rospy would tell in a traceback: `sent` tells of it instead.
    """

    def message(read: Any, screen: Screen) -> Any:
        def deserialize(self: Any, data: bytes) -> Any:
            unread, is_too_long = "", False
            try:
                screened, is_too_long = screen(data)
                read.deserialize(self, screened)
            except Exception as error:  # noqa: BLE001 - whatever another node sends
                unread = str(error) or type(error).__name__
            self._sent = Sent(data, unread, is_too_long)  # the name of no field begins so
            return self

        def serialize(self: Any, buffer: Any) -> None:
            buffer.write(sent(self).data)

        return type(read.__name__, (read,), {"deserialize": deserialize, "serialize": serialize})

    classes = {
        "_request_class": message(service_type._request_class, request),  # noqa: SLF001 - genpy's own interface
        "_response_class": message(service_type._response_class, response),  # noqa: SLF001
    }
    return type(service_type.__name__, (service_type,), classes)


def sent(message: Any) -> Sent:
    """How a message of such a type came."""
    found: Sent = message._sent  # noqa: SLF001 - set above
    return found
