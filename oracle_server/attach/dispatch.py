"""What a WebSocket's message holds, and what a monitor's message is to its session."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, assert_never

from starlette.websockets import WebSocketDisconnect

from oracle_server.attach.conversation import Received
from oracle_server.sessions.live import LiveSession
from oracle_server.sessions.monitor import Monitor
from oracle_server.wire.errors import WireError
from oracle_server.wire.incoming import (
    Attach,
    ClockMessage,
    Detach,
    EventMessage,
    HandlingMessage,
    HandlingsMessage,
    QuickClock,
    QuickEvent,
    QuickHandlings,
    ReportMessage,
)


def data_of(message: Mapping[str, Any]) -> str | bytes:
    """What a message of the socket holds. Raises `WebSocketDisconnect` where it is the last one."""
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1006))
    text: str | None = message.get("text")
    return message.get("bytes") or b"" if text is None else text


def dispatch(message: Received, session: LiveSession, monitor: Monitor) -> None:
    """Pass a monitor's message to its session. Raises `WireError` where it is refused."""
    match message:
        case QuickEvent() | EventMessage():
            session.ingest(monitor, message)
        case WireError():
            session.refuse(monitor, message)
        case QuickClock() | ClockMessage():
            session.update_clocks(monitor, message)
        case HandlingMessage():
            session.record_handling(monitor, message)
        case QuickHandlings(outcomes=outcomes) | HandlingsMessage(outcomes=outcomes):
            for outcome in outcomes:
                session.record_handling(monitor, outcome)
        case ReportMessage():
            session.report(monitor, message)
        case Detach():
            session.detach(monitor)
        case Attach():
            pass  # only the first frame, which `_attach` answers
        case _:
            assert_never(message)
