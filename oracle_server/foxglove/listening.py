"""The port that Foxglove connects to, and the channels that are offered there, by Foxglove's own library."""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, NamedTuple, ParamSpec, TypeVar, cast

import structlog

from oracle_server.core.errors import OracleError
from oracle_server.extras import install
from oracle_server.foxglove.channels import Channel, Message
from oracle_server.foxglove.schemas import Schema
from oracle_server.process.seldom import Seldom
from oracle_server.wire.json import encode_bytes

if TYPE_CHECKING:
    from foxglove.websocket import ChannelView, Client, ServerListener

Args = ParamSpec("Args")
T = TypeVar("T")
_BACKLOG = 1_024
"""Messages that wait for a client that does not read; of more the oldest are dropped."""
_FULL = "foxglove.websocket.connected_client.send_lossy"
"""The library's logger that tells of that."""
_LEVEL = "FOXGLOVE_LOG_LEVEL"
_END_WITHIN = 2.0
"""Seconds for clients to take what waits for them, when all connections end."""

log = structlog.get_logger()


class FoxgloveError(OracleError):
    """Nothing can be offered to Foxglove."""


class Certificate(NamedTuple):
    """A certificate and its key, as PEM."""

    cert: bytes
    key: bytes


_REPEATS = 10
"""How often a last message is repeated for those who have subscribed: for seconds, as on a busy machine the library may
take that long from calling us to having the subscription."""


class Listening:
    """A port on which channels are offered to whoever connects. Its methods may be called from any thread."""

    def __init__(self, host: str, port: int, tls: Certificate | None = None) -> None:
        """Listen. Raises `FoxgloveError` where that can't be done."""
        try:
            import foxglove
        except ImportError:
            raise FoxgloveError(
                f"--foxglove needs the package foxglove-sdk; install it: `{install('foxglove')}`"
            ) from None
        at = f"[{host}]" if ":" in host else host
        _set_up_logs(foxglove.set_log_level)
        self._foxglove, self._context = foxglove, foxglove.Context()
        self._offered: dict[int, Offered] = {}
        self._calls = threading.Lock()
        self.subscribed: Callable[[Offered], None] = lambda _: None
        """Called from a thread of the library's when a client has subscribed to a channel."""
        try:
            self._server = foxglove.start_server(
                name="oracle-server", host=host, port=port, capabilities=[], context=self._context,
                server_listener=cast("ServerListener", _Clients(self._on_subscribe)), message_backlog_size=_BACKLOG,
                tls_cert=tls and tls.cert, tls_key=tls and tls.key,
            )  # fmt: skip
        except (RuntimeError, ValueError, OSError) as error:
            reason = str(error).removeprefix("FoxgloveError: ")
            raise FoxgloveError(f"--foxglove: can't listen at {at}:{port}: {reason}") from None
        log.info("offering sessions to Foxglove", url=f"{'wss' if tls else 'ws'}://{at}:{self._server.port}")

    def offer(self, channel: Channel) -> Offered:
        """Offer a channel: until it is withdrawn, whoever connects is told of it."""
        name, content = channel.schema
        schema = self._foxglove.Schema(name=name, encoding="jsonschema", data=encode_bytes(content))
        made = self._alone(self._foxglove.Channel)(
            channel.topic, schema=schema, message_encoding="json", context=self._context,
            metadata=dict(channel.metadata),
        )  # fmt: skip
        send, is_read, close = self._alone(made.log), self._alone(made.has_sinks), self._alone(made.close)
        offered = Offered(made.id(), channel.schema, send, is_read, close)
        self._offered[offered.number] = offered
        return offered

    def withdraw(self, offered: Offered) -> None:
        """Offer a channel no longer."""
        self._offered.pop(offered.number, None)
        offered.close()

    def catch_up(self) -> None:
        """Repeat last messages for those who have subscribed lately. To be called now and then.

        The library may call us before a client has its subscription: what is sent in between does not reach it.
        """
        for offered in [*self._offered.values()]:
            offered.catch_up()

    def close(self) -> None:
        """End all connections, and listen no more. A client that does not read is waited for a little: it blocks."""
        ending = threading.Thread(target=self._alone(self._server.stop), name="foxglove ending", daemon=True)
        ending.start()
        ending.join(_END_WITHIN)

    def _alone(self, call: Callable[Args, T]) -> Callable[Args, T]:
        """A call of the library's, made by one thread at a time.

        The library logs that a client is slow while it has the client locked. Another thread that has the interpreter,
        and waits for that lock, would never let it log: both would stand still, and with them the server.
        """

        @wraps(call)
        def alone(*args: Args.args, **named: Args.kwargs) -> T:
            with self._calls:
                return call(*args, **named)

        return alone

    def _on_subscribe(self, number: int) -> None:
        offered = self._offered.get(number)
        if offered is not None:
            offered.subscribed()
            self.subscribed(offered)


class Offered:
    """A channel that is offered, with its last message."""

    def __init__(
        self,
        number: int,
        schema: Schema,
        send: Callable[..., None],
        is_read: Callable[[], bool],
        close: Callable[[], None],
    ) -> None:
        self.number, self.schema, self.close = number, schema, close
        self._send, self._is_read = send, is_read
        self._last: Message | None = None
        self._again = _REPEATS
        """How often the last message is still to be repeated: some may have subscribed before this was made."""

    def subscribed(self) -> None:
        """Note that somebody has subscribed, or is about to: the library may call us before it sends them anything."""
        self._again = _REPEATS

    def write(self, message: Message) -> None:
        """Send a message to those who have subscribed."""
        self._last = message
        if self._is_read():
            self.repeat()

    def repeat(self) -> None:
        """Send the last message again, for one who has just subscribed: the next may take long to come."""
        last = self._last
        if last is not None:
            self._send(encode_bytes(last.data), log_time=last.time)

    def catch_up(self) -> None:
        """Repeat the last message, once there is one and the library sends it, where somebody has subscribed lately."""
        if self._again and self._last is not None and self._is_read():
            self._again -= 1
            self.repeat()


class _Clients:
    """What is done when clients subscribe; nothing else that they send is taken."""

    def __init__(self, subscribed: Callable[[int], None]) -> None:
        self._subscribed = subscribed

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        del client
        self._subscribed(channel.id)

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        del client, channel


def _set_up_logs(begin: Callable[[str], None]) -> None:
    """Of the library's log keep that a client is slow, one line a second; its own threads log nothing.

    They have locked what a thread that has the interpreter may wait for (see `Listening._alone`), and whoever connects
    can make them log. Only the variable of the environment has a level for each logger, and it comes before the other.
    """
    logging.getLogger(_FULL).setLevel(logging.INFO)
    seldom = Seldom()

    def let_through(record: logging.LogRecord) -> bool:
        record.levelno, record.levelname = logging.WARNING, "WARNING"
        text = "a client of Foxglove reads too slowly, and misses the oldest messages"
        record.msg, record.args = f"{text}: {record.getMessage()}", ()
        return bool(seldom.due(record.name))

    logging.getLogger(_FULL).addFilter(let_through)
    given = os.environ.get(_LEVEL)
    os.environ[_LEVEL] = f"off,{_FULL.replace('.', '::')}=info"
    try:
        begin("CRITICAL")
    finally:
        if given is None:
            del os.environ[_LEVEL]
        else:
            os.environ[_LEVEL] = given
