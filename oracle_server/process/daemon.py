"""A server in the background: started, stopped and asked how it is by its data directory."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

import httpx

from oracle_server.core.errors import OracleError
from oracle_server.process.notify import VARIABLE
from oracle_server.process.pidfile import Running, running
from oracle_server.process.settings import Settings

LOG = "server.log"
NOT_RUNNING = 3
"""The exit status of `status` where no server runs."""
_LOOK_EVERY = 0.05
_ON_THE_COMMAND_LINE = ("specs", "host", "port", "legacy", "tls_cert", "tls_key", "tls_client_ca", "insecure")


class DaemonError(OracleError):
    """A server that does not start or stop as it was told to."""


def start(settings: Settings, within: float) -> None:
    """Start a server, and return once it accepts work. Raises `DaemonError` where it does not in `within` seconds."""
    folder = settings.data_dir.absolute()
    other = running(folder)
    if other is not None:
        raise DaemonError(f"{folder}: its server runs already (pid {other.pid}); `oracle-server stop` ends it")
    log = settings.log_file or folder / LOG
    with _open_log(log) as output, _readiness() as (listener, address):
        begin = output.seek(0, os.SEEK_END)
        process = subprocess.Popen(
            [sys.executable, "-m", "oracle_server", "serve"],
            env=_environment(settings, log) | {VARIABLE: address},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
        _wait_until_ready(process, listener, time.monotonic() + within, log, begin)
    started = running(folder)
    sys.stdout.write(f"{started.url if started else 'started'}: accepts work (pid {process.pid}, log {log})\n")


def stop(folder: Path, within: float) -> None:
    """Stop a server: it judges and commits what it holds, then ends. Raises `DaemonError` where it does not in time."""
    server = running(folder)
    if server is None:
        sys.stdout.write(f"{folder}: no server runs\n")
        return
    try:
        os.kill(server.pid, signal.SIGTERM)
    except OSError as error:
        raise DaemonError(f"pid {server.pid}: can't be told to stop: {error.strerror}") from None
    deadline = time.monotonic() + within
    while (left := running(folder)) is not None and left.pid == server.pid:  # it may tell its address only now
        if time.monotonic() > deadline:
            raise DaemonError(
                f"pid {server.pid}: has not stopped within {within:g} s; {folder / LOG} may say why. "
                f"`kill -9 {server.pid}` ends it, and loses nothing that was acked"
            )
        time.sleep(_LOOK_EVERY)
    sys.stdout.write(f"{server.url or folder}: stopped\n")


def status(folder: Path, *, as_json: bool) -> int:
    """Print how a server stands; 0 where one runs, 3 where none does."""
    server = running(folder)
    state = _state(server)
    if as_json:
        document = {"state": state, "pid": server and server.pid, "url": server and server.url}
        sys.stdout.write(json.dumps(document | {"data_dir": str(folder)}) + "\n")
    elif server is None:
        sys.stdout.write(f"{folder}: no server runs\n")
    else:
        sys.stdout.write(f"{server.url or folder}: {state} (pid {server.pid})\n")
    return NOT_RUNNING if server is None else 0


def _state(server: Running | None) -> str:
    """In a word: `stopped`, `starting`, `ready`, `not ready`, or `running` where it can't be asked from here."""
    if server is None:
        return "stopped"
    if server.url is None:
        return "starting"
    if not server.url.startswith("http:"):
        return "running"  # its certificates are for its clients
    try:
        with httpx.Client(trust_env=False, timeout=5.0) as http:
            return "ready" if http.get(f"{server.url}/readyz").is_success else "not ready"
    except httpx.HTTPError:
        return "not ready"


def _environment(settings: Settings, log: Path) -> dict[str, str]:
    """The environment of this process, with every setting in it that was given here."""
    given = {name: getattr(settings, name) for name in _ON_THE_COMMAND_LINE}
    given |= {"data_dir": settings.data_dir.absolute(), "log_file": log.absolute()}
    return os.environ | {f"ORACLE_{name.upper()}": str(value) for name, value in given.items() if value is not None}


def _open_log(log: Path) -> IO[bytes]:
    try:
        log.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        return log.open("ab")
    except OSError as error:
        raise DaemonError(f"{log}: can't be written: {error.strerror}") from None


@contextlib.contextmanager
def _readiness() -> Iterator[tuple[socket.socket, str]]:
    """A socket on which the server tells that it accepts work, and its address."""
    with (
        tempfile.TemporaryDirectory(prefix="oracle-") as folder,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener,
    ):
        address = f"{folder}/notify"
        listener.bind(address)
        listener.settimeout(_LOOK_EVERY)
        yield listener, address


def _wait_until_ready(
    process: subprocess.Popen[bytes], listener: socket.socket, deadline: float, log: Path, begin: int
) -> None:
    while True:
        with contextlib.suppress(TimeoutError):
            if b"READY=1" in listener.recv(4096).split(b"\n"):
                return
        if process.poll() is not None:
            raise DaemonError(_last_words(log, begin) or f"the server ended at once; {log} may say why")
        if time.monotonic() > deadline:
            raise DaemonError(
                f"the server (pid {process.pid}) does not accept work yet and goes on trying; "
                f"`oracle-server status` tells when it does, {log} what it is at"
            )


def _last_words(log: Path, begin: int) -> str:
    """What a server that could not start has said at last."""
    with log.open("rb") as file:
        file.seek(begin)
        lines = file.read().decode(errors="replace").strip().split("\n")
    return lines[-1].removeprefix("oracle-server: ")
