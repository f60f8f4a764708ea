"""Programs forked from one process that has imported what they need: most of a start is imports, a second each time.

Run as a program it imports the modules that its arguments name, waits at the socket that is its standard input, and
forks for each request; without arguments it is for the product's own command. What is forked is a process like any
other, by the environment, arguments and streams that it is given. What only the start of a Python sees of an
environment is as it is for the first; where it is to be another, start it in the ordinary way.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib
import json
import os
import re
import runpy
import select
import signal
import socket
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

STRICT = {
    "PYTHONWARNDEFAULTENCODING": "1",
    "PYTHONWARNINGS": "error::EncodingWarning,ignore::EncodingWarning:rosbags.rosbag2.reader",
}
"""Makes it an error to open a text file in the encoding of the machine's locale."""
_AT_START = re.compile("PYTHON|LC_|LANG|LD_|TZ|MALLOC")
"""Begins the names of variables that the start of a Python sees."""
_LONGEST = 1_000_000
_SPECS = Path(__file__).parent / "whole" / "specs"
IMPORTED = (
    "oracle_server.api.app", "oracle_server.server", "oracle_server.replay.many.command",
    # what is imported only where it is needed
    "oracle_server.engines.stl.parse", "fastapi_offline", "pydantic.v1", "uvicorn.lifespan.off",
)  # fmt: skip
"""What is forked has these."""


class Forked:
    """A command that runs, with the methods of `subprocess.Popen` that the tests need."""

    def __init__(self, pid: int, ended: int) -> None:
        """`ended` is a pipe, in which its exit status will be."""
        self.pid = pid
        self._ended = ended
        self._status: int | None = None
        self._reading = threading.Lock()

    def poll(self) -> int | None:
        """Its exit status, or minus the signal that ended it; None while it runs."""
        return self._read(0)

    def wait(self, timeout: float) -> int:
        """Wait for its end; TimeoutExpired after `timeout` (s)."""
        status = self._read(timeout)
        if status is None:
            raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
        return status

    def send_signal(self, number: signal.Signals) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            with contextlib.suppress(ProcessLookupError):  # it has ended just now
                os.kill(self.pid, number)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def _read(self, timeout: float) -> int | None:
        ends = select.poll()
        ends.register(self._ended, select.POLLIN)
        if self._status is None and ends.poll(1000 * timeout):
            with self._reading:  # two may have waited
                if self._status is None:
                    self._status = os.waitstatus_to_exitcode(int(os.read(self._ended, 16)))
                    os.close(self._ended)
        return self._status


class Request(NamedTuple):
    """What is to be forked; without a module it is the product's command."""

    arguments: list[str]
    environment: dict[str, str]
    folder: str
    prelude: str
    module: str


class Forks:
    """The process that has imported what is needed, which is started with the first command."""

    def __init__(self, python: Path, environment: Mapping[str, str], *modules: str) -> None:
        """`python` is the one that the product is installed for, or that has these modules."""
        self._command, self._environment = [str(python), "-P", __file__, *modules], dict(environment)
        self._asking = threading.Lock()
        self._socket: socket.socket | None = None

    def takes(self, environment: Mapping[str, str]) -> bool:
        """Whether a command started with this environment would see nothing else than one that is forked."""
        return _seen(environment) == _seen(self._environment)

    def fork(
        self,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        out: int,
        error: int,
        prelude: str = "",
        module: str = "",
    ) -> Forked:
        """Run `oracle-server`, or a module, with these arguments here, its output to these files.

        `prelude` is Python that it runs before; what it changes is not seen by modules that have it by its name.
        """
        ended, end = os.pipe()
        asked_for = Request(list(arguments), dict(environment), str(Path.cwd()), prelude, module)
        request = json.dumps(asked_for._asdict()).encode()
        try:
            with self._asking:
                asked = self._started()
                socket.send_fds(asked, [request], [out, error, end])
                return Forked(int(asked.recv(16)), ended)
        finally:
            os.close(end)

    def _started(self) -> socket.socket:
        if self._socket is None:
            self._socket, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            with theirs:
                process = subprocess.Popen(self._command, stdin=theirs.fileno(), env=self._environment)
            atexit.register(process.wait)
            atexit.register(self._socket.close)
        return self._socket


def _seen(environment: Mapping[str, str]) -> dict[str, str]:
    return {name: value for name, value in environment.items() if _AT_START.match(name)}


def _serve(requests: socket.socket) -> Request | None:
    """Fork until nobody asks any more, which is None; in what is forked, what it is to be."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        request, files, _, _ = socket.recv_fds(requests, _LONGEST, 3)
        _count_the_ended()
        if not request:
            return None
        out, error, end = files
        if not os.fork():
            child = os.fork()
            if not child:
                break
            requests.send(str(child).encode())
            os.close(out)
            os.close(error)
            os.write(end, str(os.waitpid(child, 0)[1]).encode())
            os._exit(0)
        for file in files:
            os.close(file)
    requests.close()
    os.close(end)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _write_to(out, error)
    return _become(Request(**json.loads(request)))


def _count_the_ended() -> None:
    """Wait for those that have ended: else what they worked is in no time that is told of the tests."""
    with contextlib.suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def _write_to(out: int, error: int) -> None:
    nothing = os.open(os.devnull, os.O_RDONLY)
    for number, file in enumerate((nothing, out, error)):
        os.dup2(file, number)
        os.close(file)
    sys.stdin = open(0, encoding="utf-8")  # noqa: SIM115
    lines = 1 if os.environ.get("PYTHONUNBUFFERED") else -1
    sys.stdout = open(1, "w", encoding="utf-8", buffering=lines)  # noqa: SIM115
    sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", buffering=1)  # noqa: SIM115


def _become(request: Request) -> Request:
    os.environ.clear()
    os.environ.update(request.environment)
    os.chdir(request.folder)
    tempfile.tempdir = None  # it was found by the environment of the first
    sys.argv = [request.module or "oracle-server", *request.arguments]
    if request.module:
        sys.path.insert(0, request.folder)  # as `python -m` does
    return request


def _prepare() -> None:
    """What all commands of the product begin with."""
    from oracle_server.api.openapi import description
    from oracle_server.specfiles.load import load_spec

    for path in _SPECS.glob("*.yaml"):  # what the first one needs takes long to make, such as parsers
        load_spec(path)
    description()  # as do the first routes


if __name__ == "__main__":
    import gc

    for name in sys.argv[1:] or IMPORTED:
        importlib.import_module(name)
    if not sys.argv[1:]:
        _prepare()
    gc.freeze()
    _request = _serve(socket.socket(fileno=os.dup(0)))
    if _request is not None:
        exec(_request.prelude)
        if _request.module:
            runpy.run_module(_request.module, run_name="__main__", alter_sys=True)
        else:
            from oracle_server.cli.commands import main

            main()
