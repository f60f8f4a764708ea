"""What `edge` and server.py take from uvicorn without its promise: still there, and still called alike."""

from __future__ import annotations

import asyncio
import inspect

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import Server, ServerState

from oracle_server.edge.transport import HttpTransport, WebSocketTransport
from oracle_server.server import _Server

METHODS: dict[type, dict[str, list[str]]] = {
    H11Protocol: {
        "connection_made": ["transport"],
        "connection_lost": ["exc"],
        "data_received": ["data"],
        "handle_websocket_upgrade": ["event"],
        "pause_writing": [],
        "resume_writing": [],
        "send_400_response": ["msg"],
    },
    WebSocketsSansIOProtocol: {
        "connection_made": ["transport"],
        "connection_lost": ["exc"],
        "data_received": ["data"],
        "handle_connect": ["event"],
        "handle_cont": ["event"],
        "handle_ping": [],
        "handle_pong": ["event"],
        "keepalive_timeout": [],
        "receive": [],
        "run_asgi": [],
        "schedule_ping": [],
        "send": ["message"],
        "send_keepalive_ping": [],
        "send_receive_event_to_app": [],
    },
    Server: {
        "capture_signals": [],
        "handle_exit": ["sig", "frame"],
        "shutdown": ["sockets"],
        "startup": ["sockets"],
    },
}
"""Methods that are overridden or called, and their parameters."""
CALLED = {"schedule_ping", "handle_exit"}
HTTP_FIELDS = ("app_state", "config", "connections", "conn", "cycle", "loop", "transport")
WEBSOCKET_FIELDS = (
    "app_state", "close_sent", "conn", "curr_msg_data_type", "frames", "handshake_complete", "loop",
    "pending_ping_payload", "pong_timer", "queue",
    "read_paused", "transport", "writable",
)  # fmt: skip


async def app(scope: object, receive: object, send: object) -> None: ...


def changed(owner: type, methods: dict[str, list[str]]) -> list[str]:
    """What of these methods is gone or has other parameters, each in words."""
    found = []
    for name, parameters in methods.items():
        method = getattr(owner, name, None)
        if method is None:
            found.append(f"{owner.__name__}.{name} is gone")
        elif (now := list(inspect.signature(method).parameters)[1:]) != parameters:
            found.append(f"{owner.__name__}.{name} takes {now}, not {parameters}")
    return found


def test_the_methods_that_are_overridden_or_called_are_as_they_were() -> None:
    words = [what for owner, methods in METHODS.items() for what in changed(owner, methods)]
    assert words == [], f"uvicorn {uvicorn.__version__} has changed; see edge/transport.py and server.py"


async def test_the_fields_that_are_used_are_there() -> None:
    config, loop = uvicorn.Config(app, ws="none"), asyncio.get_running_loop()
    config.load()
    words = []
    for owner, fields in ((H11Protocol, HTTP_FIELDS), (WebSocketsSansIOProtocol, WEBSOCKET_FIELDS)):
        made = owner(config, ServerState(), {}, loop)
        words += [f"{owner.__name__}.{name} is gone" for name in fields if not hasattr(made, name)]
    if "self.response_complete" not in inspect.getsource(RequestResponseCycle.__init__):
        words.append("RequestResponseCycle.response_complete is gone")
    begun = inspect.getsource(Server.startup)
    used = ("self.servers", "config.http_protocol_class", "self.server_state", "self.lifespan.state")
    words += [f"Server.startup has no {name}" for name in used if name not in begun]
    if "self.scope" not in inspect.getsource(WebSocketsSansIOProtocol.handle_connect):
        words.append("WebSocketsSansIOProtocol.scope is gone")
    assert words == [], f"uvicorn {uvicorn.__version__} has changed; see edge/transport.py and server.py"


def test_every_method_that_is_overridden_is_looked_at() -> None:
    ours = {H11Protocol: HttpTransport, WebSocketsSansIOProtocol: WebSocketTransport, Server: _Server}
    for owner, own in ours.items():
        layers = own.__mro__[: own.__mro__.index(owner)]
        functions = {name for layer in layers for name, value in vars(layer).items() if inspect.isfunction(value)}
        overridden = {name for name in functions if hasattr(owner, name)}
        assert overridden - {"__init__"} == METHODS[owner].keys() - CALLED, own.__name__


def test_what_has_changed_is_named() -> None:
    class Later:
        def startup(self, listeners: object) -> None: ...

    assert changed(Later, METHODS[Server]) == [
        "Later.capture_signals is gone",
        "Later.handle_exit is gone",
        "Later.shutdown is gone",
        "Later.startup takes ['listeners'], not ['sockets']",
    ]
