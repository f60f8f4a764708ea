"""Builds the server, starts its parts in order, and stops them in the opposite one."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path

import structlog
import uvicorn

from oracle_server.api import build_app
from oracle_server.clock import Clock
from oracle_server.core.errors import OracleError
from oracle_server.gate import Gate
from oracle_server.library import Library
from oracle_server.protocol import MAX_FRAME
from oracle_server.registry import Registry
from oracle_server.settings import Settings
from oracle_server.store import Store

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_STOP_WITHIN = 10

log = structlog.get_logger()


class ServerError(OracleError):
    """The server refuses to start."""


def serve(settings: Settings) -> None:
    """Run a server until SIGTERM or SIGINT. Raises `OracleError` where it refuses to start."""
    _set_up_log(settings)
    if settings.host not in _LOOPBACK:
        raise ServerError(f"{settings.host}: this version binds loopback addresses only; use 127.0.0.1")
    library = Library(_specs_folder(settings), settings.data_dir / "specs")
    if settings.legacy is not None:
        library.get(settings.legacy)  # refuses one that is not on hand
    listener = _listen(settings.host, settings.port)
    try:
        store = Store(settings.data_dir, settings.durability)
        try:
            asyncio.run(_serve(settings, library, store, listener))
        finally:
            store.close()
    finally:
        listener.close()


async def _serve(settings: Settings, library: Library, store: Store, listener: socket.socket) -> None:
    store.start(asyncio.get_running_loop())
    (latest,) = store.read("SELECT max(judged) FROM steps")[0]
    registry = Registry(store, library, Clock(at_least=latest or 0), settings.resume_within)
    await registry.restore_all()
    app = build_app(registry, library, store, settings.legacy)
    config = uvicorn.Config(
        Gate(app, hosts=(settings.host,)),
        ws="websockets-sansio",
        ws_max_size=MAX_FRAME,
        ws_per_message_deflate=False,
        ws_ping_interval=5,
        ws_ping_timeout=5,
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        timeout_graceful_shutdown=_STOP_WITHIN,
    )
    await _Server(config, registry, settings).serve(sockets=[listener])


class _Server(uvicorn.Server):
    """Says when work is accepted, and judges, commits and tells the monitors before connections are closed."""

    def __init__(self, config: uvicorn.Config, registry: Registry, settings: Settings) -> None:
        super().__init__(config)
        self._registry, self._settings = registry, settings

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop on SIGTERM and SIGINT without raising them again afterwards: a clean stop exits with 0."""
        loop = asyncio.get_running_loop()
        for number in (signal.SIGTERM, signal.SIGINT):
            loop.add_signal_handler(number, self.handle_exit, number, None)
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listener in sockets or ():
            host, port = listener.getsockname()[:2]
            log.info("accepting work", url=f"http://{_bracketed(host)}:{port}", data=str(self._settings.data_dir))

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        log.info("stopping")
        await self._registry.shut_down()
        await super().shutdown(sockets)
        log.info("stopped")


def _specs_folder(settings: Settings) -> Path | None:
    if settings.specs is not None:
        if not settings.specs.is_dir():
            raise ServerError(f"{settings.specs}: is no folder; name the folder of the specs")
        return settings.specs
    default = Path("specs")
    return default if default.is_dir() else None


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio turns Nagle's algorithm off only where the protocol is named; with it a decision can wait 40 ms
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
    except OSError as error:
        listener.close()
        mend = "; stop what uses it, or choose another --port" if error.errno == errno.EADDRINUSE else ""
        raise ServerError(f"{_bracketed(host)}:{port}: {error.strerror}{mend}") from None
    return listener


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


def _set_up_log(settings: Settings) -> None:
    renderer = (
        structlog.processors.JSONRenderer()
        if settings.log == "json"
        else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            structlog.processors.format_exc_info,
            renderer,
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
    )
    logging.basicConfig(stream=sys.stderr, level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    logging.getLogger("uvicorn.error").addFilter(_without_traceback)


def _without_traceback(record: logging.LogRecord) -> bool:
    """A client's malformed text is no bug of ours: one line says so."""
    if record.getMessage().startswith("Invalid UTF-8"):
        record.exc_info = None
    return True
