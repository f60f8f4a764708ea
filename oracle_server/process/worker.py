"""A process that works beside the server: of lower priority, and with an interpreter of its own.

A thread that computes for some tens of milliseconds would keep decisions waiting for the interpreter. A message between
the two is a length of four bytes and so many bytes. The process ends with the one that has started it.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import msgspec

import oracle_server
from oracle_server.core.errors import OracleError

_STARTING = 60.0
"""Seconds that a process may take to start, beyond those for its first answer, on a machine that does much else."""
_encode = msgspec.msgpack.Encoder().encode


class WorkerError(OracleError):
    """A process that gave no answer."""


def command(module: str, *arguments: str) -> tuple[list[str], dict[str, str]]:
    """The command line and the environment of a module of this package as a process.

    It is found where this is; nothing is taken from the folder that this was started in, as a `yaml.py` of somebody's.
    """
    paths = str(Path(oracle_server.__file__).parents[1]), os.environ.get("PYTHONPATH")
    env = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return [sys.executable, "-P", "-m", module, *arguments], env


def unstarted(error: OSError) -> str:
    """What is said where the system starts no process, as of a container that may have no more."""
    return f"the system starts no process for it: {error.strerror or error}"


def step_back(nice: int) -> None:
    """To be called by such a process first: it gives way to the server, and does not end with its terminal."""
    os.nice(nice)
    for number in (signal.SIGINT, signal.SIGHUP):  # which are sent to all: the server ends this
        signal.signal(number, signal.SIG_IGN)


def send(pipe: IO[bytes], message: object) -> None:
    """Write a message."""
    data = _encode(message)
    pipe.write(len(data).to_bytes(4, "big") + data)
    pipe.flush()


def receive(pipe: IO[bytes]) -> bytes:
    """Read a message; nothing where the other side is gone."""
    size = pipe.read(4)
    data = pipe.read(int.from_bytes(size, "big"))
    return data if len(size) == 4 and len(data) == int.from_bytes(size, "big") else b""


class Worker:
    """Asks a process, one question at a time; it is started with the first, and anew where it has ended."""

    def __init__(self, module: str, arguments: Sequence[str] = ()) -> None:
        """Ask a module of this package, which reads from its standard input and answers on its standard output."""
        self._module, self._arguments = module, arguments
        self.process: subprocess.Popen[bytes] | None = None
        self._closed = False

    def ask(self, request: object, within: float) -> bytes:
        """The answer, within so many seconds. Raises `WorkerError`, and ends the process, where there is none."""
        if self.process is not None and self.process.poll() is not None:
            self.end()  # it was ended, by whoever it was
        if self.process is None:
            self.process = self._started()
            within += _STARTING
        process = self.process
        assert process.stdin is not None  # noqa: S101 -- as it was started so
        assert process.stdout is not None  # noqa: S101
        data, late = b"", False
        try:
            send(process.stdin, request)
            late = not select.select([process.stdout], [], [], within)[0]
            data = b"" if late else receive(process.stdout)
        except (OSError, ValueError):  # it has ended, or is closed
            pass
        if not data:
            self.end()
            raise WorkerError(f"no answer within {within:.0f} s" if late else "the process has ended without an answer")
        return data

    def close(self) -> None:
        """End the process for good."""
        self._closed = True
        self.end()

    def end(self) -> None:
        """End the process; the next question starts another."""
        process, self.process = self.process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with contextlib.suppress(OSError):
                        pipe.close()

    def _started(self) -> subprocess.Popen[bytes]:
        if self._closed:
            raise WorkerError("the server stops")
        line, env = command(self._module, *self._arguments)
        try:
            return subprocess.Popen(line, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env)  # noqa: S603
        except OSError as error:
            raise WorkerError(unstarted(error)) from None
