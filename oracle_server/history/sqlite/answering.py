"""A process that answers questions by time: of lower priority, and with an interpreter of its own.

A thread that computes for some tens of milliseconds would keep decisions waiting for the interpreter. A request and its
answer are each a length of four bytes and so many bytes. The process ends with the one that has started it.
"""

from __future__ import annotations

import os
import signal
import sqlite3
import sys
from contextlib import closing
from typing import IO, NamedTuple

import msgspec

from oracle_server.core.errors import UnpreparedError
from oracle_server.history.records import SessionRecord
from oracle_server.history.sqlite.timeline import asked
from oracle_server.history.timeline import Question

_NICE = 10


class Request(NamedTuple):
    """A question about a session."""

    session: SessionRecord
    question: Question


class Answer(msgspec.Struct):
    """What comes of it, or why nothing does: `unprepared`, or else the database can't be read."""

    body: bytes = b""
    error: str | None = None
    unprepared: bool = False


_request = msgspec.msgpack.Decoder(Request).decode
_encode = msgspec.msgpack.Encoder().encode


def send(pipe: IO[bytes], message: object) -> None:
    """Write a request or an answer."""
    data = _encode(message)
    pipe.write(len(data).to_bytes(4, "big") + data)
    pipe.flush()


def receive(pipe: IO[bytes]) -> bytes:
    """Read a request or an answer; nothing where the other side is gone."""
    size = pipe.read(4)
    data = pipe.read(int.from_bytes(size, "big"))
    return data if len(size) == 4 and len(data) == int.from_bytes(size, "big") else b""


def main() -> None:
    """Answer what is asked on the standard input about the database at a URI, until its end."""
    (uri,) = sys.argv[1:]
    os.nice(_NICE)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # of a terminal, which sends it to all: the server ends this
    while request := receive(sys.stdin.buffer):
        try:
            send(sys.stdout.buffer, _answered(uri, _request(request)))
        except BrokenPipeError:
            return


def _answered(uri: str, request: Request) -> Answer:
    try:
        with closing(sqlite3.connect(uri, uri=True, isolation_level=None)) as reader:
            return Answer(asked(reader, *request))
    except UnpreparedError as error:
        return Answer(error=str(error), unprepared=True)
    except sqlite3.Error as error:
        return Answer(error=f"the history can't be read: {error}")


if __name__ == "__main__":
    main()
