"""A process that answers questions of clients."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import closing
from importlib import import_module
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.errors import HistoryError, UnpreparedError
from oracle_server.history.query import Query
from oracle_server.history.records import SessionRecord
from oracle_server.history.sql.damage import DAMAGED, damaged
from oracle_server.history.sql.matching import told
from oracle_server.history.sql.timeline import asked
from oracle_server.history.timeline import Question
from oracle_server.history.views import Doubts
from oracle_server.process.worker import receive, send, step_back

_NICE = 5


class Opening(NamedTuple):
    """What opens a connection: a module, the name of a function in it, and its argument.

    It is told by the pipe: the argument may hold a password, and all users can read a process's arguments.
    """

    module: str
    name: str
    target: bytes


class ByTime(msgspec.Struct, tag=True):
    """A question for what went on by time: its answer is JSON."""

    session: SessionRecord
    question: Question


class ByNumber(msgspec.Struct, tag=True):
    """A question for verdict records: its answer is a `Told`."""

    session: SessionRecord
    query: Query
    position: int
    doubts: Doubts | None


class Request(NamedTuple):
    """A question, and the database that it is about."""

    opening: Opening
    question: ByTime | ByNumber


class Answer(msgspec.Struct):
    """What comes of it, or why nothing does: `unprepared`, or else the database can't be read."""

    body: bytes = b""
    error: str | None = None
    unprepared: bool = False


_encode = msgspec.msgpack.Encoder().encode
_request: Callable[[bytes], Request] = msgspec.msgpack.Decoder(Request).decode


def main() -> None:
    """Answer what is asked on the standard input, until its end."""
    step_back(_NICE)
    while request := receive(sys.stdin.buffer):
        try:
            send(sys.stdout.buffer, _answered(*_request(request)))
        except BrokenPipeError:
            return


def _answered(opening: Opening, asks: ByTime | ByNumber) -> Answer:
    try:
        connect: Callable[[str], Any] = getattr(import_module(opening.module), opening.name)
        with closing(connect(os.fsdecode(opening.target))) as reader:
            if isinstance(asks, ByTime):
                return Answer(asked(reader, asks.session, asks.question))
            return Answer(_encode(told(reader, asks.session, asks.query, asks.position, asks.doubts)))
    except UnpreparedError as error:
        return Answer(error=str(error), unprepared=True)
    except HistoryError as error:
        return Answer(error=str(error))
    except DAMAGED as error:
        return Answer(error=damaged(error, f"a row of session {asks.session.id}"))
    except Exception as error:  # noqa: BLE001 -- of whatever database
        return Answer(error=f"the history can't be read: {error}")


if __name__ == "__main__":
    main()
