"""The server: builds its parts, starts them in order, and stops them in reverse."""

from __future__ import annotations

import asyncio
import contextlib
import faulthandler
import importlib.util
import os
import re
import signal
import socket
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import structlog
import uvicorn

from oracle_server.api.app import build_app
from oracle_server.api.recordings import PATH as RECORDINGS
from oracle_server.core.errors import OracleError, SpecError
from oracle_server.core.spec import Retention
from oracle_server.edge.access import Access
from oracle_server.edge.bodies import Bodies
from oracle_server.edge.caching import Caching
from oracle_server.edge.certificates import Certificates
from oracle_server.edge.crowds import Crowds
from oracle_server.edge.heads import Heads
from oracle_server.edge.listening import bracketed, listen, listening_unix
from oracle_server.edge.origins import Origins
from oracle_server.edge.readonly import ReadOnly
from oracle_server.edge.scopes import RouteScopes
from oracle_server.edge.slashes import Slashes
from oracle_server.edge.tokens import Tokens
from oracle_server.edge.transport import WebSocketTransport, http_transport
from oracle_server.edge.visitors import LEAVING, STRANGERS, Visitors
from oracle_server.extras import install
from oracle_server.foxglove.listening import Certificate, Listening
from oracle_server.foxglove.live import Live
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.retention import Hold, Pruner
from oracle_server.history.sqlite.beside import SqliteBeside
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.jobs.checking import Checking
from oracle_server.jobs.forwarding import Forwarding
from oracle_server.jobs.recordings import Recordings
from oracle_server.jobs.uploads import Uploads
from oracle_server.process.clock import Clock
from oracle_server.process.garbage import collect_rarely, uncollected
from oracle_server.process.logs import set_up_logs
from oracle_server.process.notify import READY, STATUS, notify
from oracle_server.process.openfiles import connections
from oracle_server.process.pidfile import PidFile
from oracle_server.process.settings import POSTGRES, Settings, unknown_variables
from oracle_server.process.signals import when_told_to_end
from oracle_server.process.watchdog import Watchdog
from oracle_server.remote.receivers import load_receivers
from oracle_server.remote.webhooks import Webhooks
from oracle_server.rostypes.known import Types
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.sharing import close_left, share
from oracle_server.specfiles.library import Library, UnknownSpecError, Unsound
from oracle_server.wire.incoming import MAX_FRAME

_LOOPBACK = ("127.0.0.1", "::1", "localhost")
_STOP_WITHIN = 10
PING = 5.0
"""Seconds between two pings of a WebSocket, and for the answer to one."""
_OTHER_FILES = STRANGERS + LEAVING + 200
"""Files that the server has open beyond its connections: those that come and go, and its history's."""
_IN_MEMORY = 200_000
"""Steps of a recording that are kept where the history is in memory."""
_LOOKS = 10
"""How often, while a lease lasts, a server looks whether one of another server has run out."""
_SWITCH_INTERVAL = 0.001
"""Seconds after which a computing thread yields the interpreter to the event loop, which must decide quickly."""

log = structlog.get_logger()


class ServerError(OracleError):
    """The server refuses to start."""


def serve(settings: Settings) -> None:
    """Run a server until SIGTERM, SIGINT or SIGHUP. Raises `OracleError` where it refuses to start."""
    os.umask(0o077)  # all that it writes says what robots did
    faulthandler.enable()  # where systemd ends a server that stands still, its journal says where
    with contextlib.ExitStack() as held:
        held.callback(set_up_logs(settings))
        if unknown := unknown_variables():
            log.warning("environment variables that name no setting are ignored", names=", ".join(unknown))
        pid_file = None
        if not settings.read_only:
            pid_file = PidFile(settings.data_dir)
            held.callback(pid_file.release)
        tokens = Tokens(settings.token_file)
        if settings.tokens is not None and not tokens.required:
            missing = str(settings.tokens)
            log.warning("no token is asked for: the file that ORACLE_TOKENS names is not there", file=missing)
        _require_protection(settings, tokens)
        tls = _certificates(settings)
        _require_permission(settings, tokens)
        library = _library(settings)
        receivers = load_receivers(settings.alarms) if settings.alarms else []
        visitors = Visitors(connections(settings.max_connections, _OTHER_FILES))
        listener = held.enter_context(listen(settings.host, settings.port, visitors))
        unix = held.enter_context(listening_unix(settings.unix, visitors))
        foxglove = None if settings.foxglove is None else _listen_to_foxglove(settings, settings.foxglove)
        webhooks = Webhooks(receivers) if receivers else None
        if webhooks:
            held.callback(webhooks.close)
        history = _history(settings, listener.getsockname()[1])
        held.callback(history.close)
        door = _Door(tokens, tls, pid_file, listener, unix, visitors, webhooks, foxglove)
        try:
            asyncio.run(_serve(settings, library, history, door))
        except asyncio.CancelledError:
            log.info("stopped before it accepted work")
        if history.fenced is not None:
            raise ServerError(f"{history.fenced}; start it again")


def _library(settings: Settings) -> Library:
    """The specs on hand; unsound ones are logged. Raises `ServerError` where that of `--legacy` is not there."""
    library = Library(_specs_folder(settings), settings.data_dir / "specs", Types(settings.type_folders))
    for entry in library.listed():
        if isinstance(entry, Unsound):
            reasons = "; ".join(str(finding) for finding in entry.error.findings)
            log.error("a spec is unsound: no session can be opened by it", spec=entry.id, reasons=reasons)
    if wanting := library.wanting():
        notify(f"{STATUS}{wanting}")
    if settings.legacy is not None:
        try:
            library.get(settings.legacy)
        except UnknownSpecError as error:
            raise ServerError(f"--legacy, or ORACLE_LEGACY: {error}") from None
        except SpecError:
            pass  # it is logged, and may be mended
    return library


def _history(settings: Settings, port: int) -> History:
    if settings.read_only:
        return SqliteBeside(settings.data_dir)
    if settings.history == "sqlite":
        return SqliteHistory(settings.data_dir, settings.durability, forwarding=settings.forward is not None)
    if settings.history.startswith(POSTGRES):
        return _in_postgres(settings, port)
    log.warning("the history is kept in memory: it ends with this process, and an ack does not outlive it")
    return MemoryHistory()


def _in_postgres(settings: Settings, port: int) -> History:
    try:
        from oracle_server.history.postgres.history import PostgresHistory
        from oracle_server.history.postgres.store import Node
    except ImportError:
        raise ServerError(
            f"a history in PostgreSQL needs the package psycopg; install it: `{install('postgres')}`"
        ) from None

    def end() -> None:
        os.kill(os.getpid(), signal.SIGTERM)

    node = Node(settings.node or f"{socket.gethostname()}:{port}", settings.advertise)
    return PostgresHistory(settings.history, settings.lease, end, node)


def _forwarding(settings: Settings, history: History) -> Forwarding | None:
    """What forwards the history, if it is to be. Raises `ServerError` where it can't."""
    if settings.forward is None or not isinstance(history, SqliteHistory) or history.forwarding is None:
        return None
    if importlib.util.find_spec("psycopg") is None:
        raise ServerError(f"--forward needs the package psycopg; install it: `{install('postgres')}`")
    return Forwarding(history.forwarding, settings.forward, settings.origin or _host())


def _host() -> str:
    """The host's name, as far as it may be a robot's."""
    return re.sub(r"[^A-Za-z0-9_.-]", "-", socket.gethostname())[:64] or "robot"


class _Door(NamedTuple):
    """How clients reach the server: by which socket, with which TLS and tokens."""

    tokens: Tokens
    tls: Certificates | None
    pid_file: PidFile | None
    listener: socket.socket
    unix: socket.socket | None
    visitors: Visitors
    webhooks: Webhooks | None
    foxglove: Listening | None


async def _serve(settings: Settings, library: Library, history: History, door: _Door) -> None:
    sys.setswitchinterval(_SWITCH_INTERVAL)
    tls, restoring = door.tls, asyncio.current_task()
    when_told_to_end(lambda _: restoring and restoring.cancel())
    history.start(asyncio.get_running_loop())
    clock = Clock(at_least=await history.last_time())
    registry = Registry(history, library, clock, settings.resume_within, alarms=door.webhooks)
    bounds = Retention(settings.retain_age, settings.retain_events, settings.retain_size)
    forwarding = _forwarding(settings, history)
    hold = None if forwarding is None else Hold(forwarding.noted.free, settings.forward_hold)
    pruner = Pruner(history, bounds, library.retention, clock.ago, registry.save, hold)
    with Watchdog() as watchdog:
        with uncollected():
            await registry.restore_all()
            await registry.take_over()
            collect_rarely()
        checking, folders = Checking(settings.type_folders), settings.type_folders
        uploads = Uploads(settings.data_dir / "recordings", settings.max_recording)
        if history.read_only is None:
            uploads.clear()
        recordings = Recordings(
            registry, library, uploads, folders, _IN_MEMORY if settings.history == "memory" else None
        )
        app = build_app(
            registry,
            library,
            history,
            watchdog,
            checking,
            recordings,
            door.webhooks,
            legacy=settings.legacy,
            legacy_finals=settings.legacy_finals,
            max_rate=settings.max_rate,
            forwarding=forwarding.progress if forwarding else None,
        )
        inside = app if history.read_only is None else ReadOnly(app, history.read_only)
        access = Access(Bodies(inside, {RECORDINGS: settings.max_recording}), door.tokens, RouteScopes(app.routes))
        config = uvicorn.Config(
            Crowds(Caching(Origins(Heads(Slashes(access)), _hosts(settings)))),
            http=http_transport(door.visitors),
            ws=WebSocketTransport,
            ws_max_size=MAX_FRAME,
            ws_per_message_deflate=False,
            ws_ping_interval=PING,
            ws_ping_timeout=PING,
            lifespan="off",
            log_config=None,
            access_log=False,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=_STOP_WITHIN,
            ssl_context_factory=(lambda *_: tls.context) if tls else None,
        )
        works = [access.watch()] + ([tls.watch()] if tls else [])
        if history.read_only is None:
            works += [pruner.run(settings.retain_check), history.catch_up()]
        if settings.history.startswith(POSTGRES):
            works.append(share(registry, history, settings.lease / _LOOKS))
            works.append(close_left(registry, history, settings.retain_check))
        if forwarding is not None:
            works.append(forwarding.run())
        if door.foxglove is not None:
            works.append(Live(door.foxglove, registry, history, lambda: _may_draw(settings, door.tokens)).run())
        beside = [asyncio.create_task(work, name=getattr(work, "__qualname__", None)) for work in works]
        for task in beside:
            task.add_done_callback(_tell_failure)
        try:
            await _Server(config, registry, recordings, settings, door).serve(sockets=[door.listener])
        finally:
            for task in beside:
                task.cancel()
            await asyncio.wait(beside)
            checking.close()
            if forwarding is not None:
                forwarding.close()


def _tell_failure(task: asyncio.Task[None]) -> None:
    """Log that something which is done beside the sessions has ended by an error: nobody waits for it."""
    if not task.cancelled() and task.exception() is not None:
        what = "something that the server does beside its sessions has failed, and is not done any more"
        log.error(what, task=task.get_name(), exc_info=task.exception())


def _hosts(settings: Settings) -> list[str]:
    """The names that the server answers to, besides those of loopback."""
    allowed = (name.strip() for name in settings.allowed_hosts.split(","))
    return [settings.host, *filter(None, allowed)]


def _require_protection(settings: Settings, tokens: Tokens) -> None:
    """Raise `ServerError` where the server would be reachable beyond loopback without tokens and TLS."""
    if settings.host in _LOOPBACK or (tokens.required and settings.tls_cert):
        return
    missing = " and ".join(
        name
        for name, there in (("a token (`oracle-server token add`)", tokens.required), ("TLS", settings.tls_cert))
        if not there
    )
    if not settings.insecure:
        raise ServerError(
            f"{settings.host}: others could reach the server there, and {missing} would be missing; "
            "set them up, bind 127.0.0.1, or add --insecure"
        )
    log.warning("reachable by others without protection", host=settings.host, missing=missing)


def _may_draw(settings: Settings, tokens: Tokens) -> bool:
    """Whether Foxglove, which sends no token, may be shown what all sessions do."""
    return settings.host in _LOOPBACK or settings.foxglove_insecure or not (tokens.required or settings.tls_client_ca)


def _require_permission(settings: Settings, tokens: Tokens) -> None:
    """Raise `ServerError` where others could read by Foxglove what they need a token or a certificate for."""
    if settings.foxglove is None:
        return
    if not _may_draw(settings, tokens):
        raise ServerError(
            f"--foxglove: Foxglove sends neither token nor certificate: whoever reaches {settings.host} could read all "
            "sessions there; bind 127.0.0.1, or add --foxglove-insecure"
        )
    if tokens.required or settings.tls_client_ca:
        log.warning("whoever reaches Foxglove's port reads all sessions, without a token", host=settings.host)


def _listen_to_foxglove(settings: Settings, port: int) -> Listening:
    """Listen for Foxglove, with the server's own certificate. Raises `FoxgloveError`."""
    certificate = None
    if settings.tls_cert is not None and settings.tls_key is not None:
        certificate = Certificate(settings.tls_cert.read_bytes(), settings.tls_key.read_bytes())
    return Listening(settings.host, port, certificate)


def _certificates(settings: Settings) -> Certificates | None:
    """The certificates of the settings, if there are any. Raises `CertificateError` where they can't be used."""
    if settings.tls_cert is None or settings.tls_key is None:
        return None
    return Certificates(settings.tls_cert, settings.tls_key, settings.tls_client_ca)


class _Server(uvicorn.Server):
    """Reports when it accepts work; to stop, closes the listeners, commits, and then closes the connections."""

    def __init__(
        self, config: uvicorn.Config, registry: Registry, recordings: Recordings, settings: Settings, door: _Door
    ) -> None:
        super().__init__(config)
        self._registry, self._recordings, self._settings, self._door = registry, recordings, settings, door

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Stop on SIGTERM, SIGINT and SIGHUP without raising them again, so that a clean stop exits with 0."""
        when_told_to_end(lambda number: self.handle_exit(number, None))
        yield

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        for listener in sockets or ():
            host, port = listener.getsockname()[:2]
            scheme = "https" if self._settings.tls_cert else "http"
            url = f"{scheme}://{bracketed(host)}:{port}"
            if self._door.pid_file is not None:
                self._door.pid_file.publish(url)
            what = "reading only, and accepting no work" if self._settings.read_only else "accepting work"
            log.info(what, url=url, data=str(self._settings.data_dir))
        if self._door.unix is not None:
            await self._begin_unix(self._door.unix)
        self._registry.accept_work()
        notify(READY)

    async def _begin_unix(self, listener: socket.socket) -> None:
        """Accept at a UNIX socket: without TLS, as nobody is between."""

        def protocol() -> asyncio.Protocol:
            return self.config.http_protocol_class(  # type: ignore[call-arg]
                config=self.config, server_state=self.server_state, app_state=self.lifespan.state
            )

        loop = asyncio.get_running_loop()
        self.servers.append(await loop.create_server(protocol, sock=listener, backlog=self.config.backlog))
        log.info("accepting work at a UNIX socket", path=listener.getsockname())

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        for listener in self.servers:
            listener.close()
        log.info("stopping")
        notify("STOPPING=1")
        await self._recordings.stop()
        await self._registry.shut_down()
        await super().shutdown(sockets)
        log.info("stopped")


def _specs_folder(settings: Settings) -> Path | None:
    if settings.specs is not None:
        if not settings.specs.is_dir():
            raise ServerError(f"{settings.specs}: is no folder; name the folder of the specs")
        return settings.specs
    default = Path("specs")
    return None if default.is_file() else default  # it may be made later
