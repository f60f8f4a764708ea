"""The commands `start`, `stop` and `status`: a server in the background, found by its data directory."""

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
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import IO, NamedTuple

import httpx

from oracle_server.core.errors import OracleError
from oracle_server.process.notify import READY, STATUS, VARIABLE
from oracle_server.process.pidfile import Running, is_held_by, running
from oracle_server.process.settings import Settings
from oracle_server.process.worker import command

LOG = "server.log"
NOT_RUNNING = 3
"""The exit status of `status` where no server runs."""
_POLL_INTERVAL = 0.05
_LONGEST = 80
"""Bytes of the path of a folder in which a UNIX socket can be: with its own name it has 107 at the most."""
_SHORT = "/tmp"  # noqa: S108 -- a folder of one's own is made in it
_ON_THE_COMMAND_LINE = (
    "specs", "types", "host", "port", "legacy", "legacy_finals", "tls_cert", "tls_key", "tls_client_ca",
    "insecure", "foxglove", "foxglove_insecure", "forward", "origin", "unix",
)  # fmt: skip


class DaemonError(OracleError):
    """A server that does not start or stop."""


class Launched(NamedTuple):
    """A server that accepts work, and what it says of itself; empty where there is nothing to say."""

    process: subprocess.Popen[bytes]
    status: str


def start(settings: Settings, within: float) -> None:
    """Start a server, and return once it accepts work. Raises `DaemonError` if it does not within `within` seconds."""
    folder = settings.data_dir.absolute()
    if settings.read_only:
        raise DaemonError("ORACLE_READ_ONLY: it is not found by its data directory; use `oracle-server serve`")
    other = running(folder)
    if other is not None and other.embedded:
        raise DaemonError(_adapters(folder, other))
    if other is not None:
        raise DaemonError(f"{folder}: its server runs already (pid {other.pid}); `oracle-server stop` ends it")
    log = settings.log_file or folder / LOG
    process, status = launch(_environment(settings, log), log, within)
    started = running(folder)
    if status:
        _warn(status)
    _tell(f"{started.url if started else 'started'}: accepts work (pid {process.pid}, log {log})")


def _tell(done: str) -> None:
    """Print what was done; where that can't be written it is done all the same, and standard error has it."""
    try:
        sys.stdout.write(f"{done}\n")
        sys.stdout.flush()
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left is written once more at the end
        _warn(f"{done}; standard output can't be written: {error.strerror}")


def _warn(text: str) -> None:
    with contextlib.suppress(OSError):
        sys.stderr.write(f"oracle-server: {text}\n")


def launch(environment: Mapping[str, str], log: Path, within: float, *, keep: bool = True) -> Launched:
    """Start a server by an environment, in a session of its own, and return once it accepts work.

    Raises `DaemonError` if it does not within `within` seconds; it is ended then, unless it is to be kept. Ctrl-C ends
    it, too, in good order.
    """
    with _open_log(log) as output, _readiness(log.parent) as (listener, address):
        begin = output.seek(0, os.SEEK_END)
        line, found = command("oracle_server", "serve")
        process = subprocess.Popen(  # noqa: S603
            line,
            env={**environment, "PYTHONPATH": found["PYTHONPATH"], VARIABLE: address},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
        try:
            status = _wait_until_ready(process, listener, time.monotonic() + within, log, begin)
        except KeyboardInterrupt:
            process.terminate()
            process.wait()
            raise
        except BaseException:
            if not keep:
                process.kill()
                process.wait()
            raise
    return Launched(process, status)


def stop(folder: Path, within: float) -> None:
    """Stop a server, and return once it has ended. Raises `DaemonError` if it does not within `within` seconds.

    The server judges and commits all held events before it ends.
    """
    server = running(folder)
    if server is None:
        _tell(f"{folder}: no server runs")
        return
    if server.embedded:
        raise DaemonError(_adapters(folder, server))
    if not is_held_by(folder, server.pid):
        raise DaemonError(
            f"{folder}: its server is no process here, as where it runs in a container (pid {server.pid} there): stop "
            "it where it was started"
        )
    try:
        os.kill(server.pid, signal.SIGTERM)
    except OSError as error:
        raise DaemonError(f"pid {server.pid}: can't be stopped: {error.strerror}") from None
    deadline = time.monotonic() + within
    while (left := running(folder)) is not None and left.pid == server.pid:  # its URL may be added meanwhile
        if time.monotonic() > deadline:
            raise DaemonError(
                f"pid {server.pid}: has not stopped within {within:g} s; see {folder / LOG}. "
                f"`kill -9 {server.pid}` ends it, and loses nothing that was acked"
            )
        time.sleep(_POLL_INTERVAL)
    _tell(f"{server.url or folder}: stopped")


def status(folder: Path, *, as_json: bool, ready: bool = False) -> int:
    """Print the state of a server; returns the exit status: 0 where one runs, `NOT_RUNNING` where none does.

    `ready`: one that is starting or not ready counts as none.
    """
    server = running(folder)
    is_here = server is not None and is_held_by(folder, server.pid)
    state = _state(server, is_here=is_here)
    if as_json:
        document = {"state": state, "pid": server and server.pid, "url": server and server.url}
        sys.stdout.write(json.dumps(document | {"data_dir": str(folder)}) + "\n")
    elif server is None:
        sys.stdout.write(f"{folder}: no server runs\n")
    elif server.embedded:
        sys.stdout.write(f"{_adapters(folder, server)}\n")
    else:
        where = "" if is_here else " there: it is no process here, as where it runs in a container, and is not asked"
        sys.stdout.write(f"{server.url or folder}: {state} (pid {server.pid}{where})\n")
    return NOT_RUNNING if server is None or server.embedded or (ready and state not in ("ready", "running")) else 0


def _state(server: Running | None, *, is_here: bool) -> str:
    """`stopped`, `embedded`, `starting`, `ready` or `not ready`; `running`: it can't be asked.

    One that wants a client's certificate can't be; nor one that is no process here: at its address may be another one.
    """
    if server is None:
        return "stopped"
    if server.embedded:
        return "embedded"
    if server.url is None or not is_here:
        return "running" if server.url else "starting"
    url = server.url.replace("//[::]:", "//localhost:")  # it is at all addresses, and IPv6 may be off
    try:  # whose address that is says the file that it has locked, and not its certificate
        with httpx.Client(trust_env=False, timeout=5.0, verify=False) as http:  # noqa: S501 -- nothing is told it
            return "ready" if http.get(f"{url}/readyz").is_success else "not ready"
    except httpx.TimeoutException:
        return "not ready"
    except httpx.HTTPError:
        return "not ready" if server.url.startswith("http:") else "running"


def _adapters(folder: Path, adapter: Running) -> str:
    """What is said of a data directory that no server uses, and an adapter does."""
    return (
        f"{folder}: no server runs: an adapter with --embedded (pid {adapter.pid}) uses this data directory; "
        "`oracle-server serve --read-only` reads it meanwhile"
    )


def _environment(settings: Settings, log: Path) -> dict[str, str]:
    """The environment of this process, with the settings from the command line added."""
    given = {name: getattr(settings, name) for name in _ON_THE_COMMAND_LINE}
    given |= {"data_dir": settings.data_dir.absolute(), "log_file": log.absolute()}
    return os.environ | {f"ORACLE_{name.upper()}": str(value) for name, value in given.items() if value is not None}


def _open_log(log: Path) -> IO[bytes]:
    try:
        log.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        if log.is_fifo():  # to open it would wait for who reads it
            raise DaemonError(f"{log}: is a pipe, and no file: delete it, or name another ORACLE_LOG_FILE")
        return open(log, "ab", opener=lambda path, flags: os.open(path, flags, 0o600))
    except OSError as error:
        where = "name a folder of yours by --data-dir, or another ORACLE_LOG_FILE"
        raise DaemonError(f"{log}: can't be written: {error.strerror}; {where}") from None


@contextlib.contextmanager
def _readiness(otherwise: Path) -> Iterator[tuple[socket.socket, str]]:
    """A socket on which the server reports that it accepts work, and the socket's address.

    `otherwise`: a folder for it where none for temporary files can be written, as where all else is read-only.
    """
    with (
        tempfile.TemporaryDirectory(prefix="oracle-", dir=_place(otherwise)) as folder,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener,
    ):
        address = f"{folder}/notify"
        listener.bind(address)
        listener.settimeout(_POLL_INTERVAL)
        yield listener, address


def _place(otherwise: Path) -> str | Path:
    try:
        usual = tempfile.gettempdir()
    except FileNotFoundError:
        return otherwise
    return usual if len(os.fsencode(usual)) <= _LONGEST else _SHORT


def _wait_until_ready(
    process: subprocess.Popen[bytes], listener: socket.socket, deadline: float, log: Path, begin: int
) -> str:
    """Returns the last `STATUS=` that the server has told before it was ready."""
    status = ""
    while True:
        with contextlib.suppress(TimeoutError):
            told = listener.recv(4096).decode(errors="replace")
            if told.startswith(STATUS):
                status = told.removeprefix(STATUS)
            elif told == READY:
                return status
        if process.poll() is not None:
            silent = f"the server ended at once, with nothing in {log}, as on a full disk; `serve` says why"
            raise DaemonError(_last_line(log, begin) or silent)
        if time.monotonic() > deadline:
            raise DaemonError(
                f"the server (pid {process.pid}) does not accept work yet and is still starting; "
                f"`oracle-server status` shows when it is ready, and {log} its progress"
            )


def _last_line(log: Path, begin: int) -> str:
    """The last line of the log after position `begin`: the error of a server that could not start."""
    with log.open("rb") as file:
        file.seek(begin)
        lines = file.read().decode(errors="replace").strip().split("\n")
    return lines[-1].removeprefix("oracle-server: ")
