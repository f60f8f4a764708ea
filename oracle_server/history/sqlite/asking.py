"""Questions by time, for the process that answers them: one after the other, of all clients in turns."""

from __future__ import annotations

import contextlib
import os
import select
import subprocess
import sys
from functools import partial
from pathlib import Path

import msgspec

import oracle_server
from oracle_server.core.errors import HistoryError, UnpreparedError
from oracle_server.history.readers import Readers
from oracle_server.history.records import SessionRecord
from oracle_server.history.sqlite import answering
from oracle_server.history.sqlite.answering import Answer, Request, receive, send
from oracle_server.history.timeline import Question

_WITHIN = 30.0
"""Seconds for an answer, a hundred times what the longest one takes."""
_answer = msgspec.msgpack.Decoder(Answer).decode


class Asking:
    """Asks a process, which is started with the first question, and anew where it has ended."""

    def __init__(self, path: Path) -> None:
        """Ask about a database."""
        self._uri = f"file:{path}?mode=ro"
        self._threads = Readers(1, 1, "timeline")
        self._process: subprocess.Popen[bytes] | None = None
        self._closed = False

    async def ask(self, session: SessionRecord, question: Question) -> bytes:
        """The answer as JSON. Raises `HistoryError`."""
        return await self._threads.start(partial(self._ask, Request(session._replace(text=""), question)))

    def close(self) -> None:
        """End the process."""
        self._closed = True
        self._end()
        self._threads.close()

    def _ask(self, request: Request) -> bytes:
        if self._process is not None and self._process.poll() is not None:
            self._end()  # it was ended, by whoever it was
        if self._process is None:
            self._process = self._started()
        process = self._process
        assert process.stdin is not None  # noqa: S101 -- as it was started so
        assert process.stdout is not None  # noqa: S101
        data = b""
        try:
            send(process.stdin, request)
            if select.select([process.stdout], [], [], _WITHIN)[0]:
                data = receive(process.stdout)
        except (OSError, ValueError):  # it has ended, or is closed
            pass
        if not data:
            self._end()
            raise HistoryError("the history's reader has ended without an answer; ask again")
        answer = _answer(data)
        if answer.error is not None:
            raise (UnpreparedError if answer.unprepared else HistoryError)(answer.error)
        return answer.body

    def _started(self) -> subprocess.Popen[bytes]:
        if self._closed:
            raise HistoryError("the server stops")
        # found where this is, and not in the folder that the server was started in
        env = os.environ | {"PYTHONPATH": str(Path(oracle_server.__file__).parents[1])}
        command = [sys.executable, "-P", "-m", answering.__name__, self._uri]
        return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env)  # noqa: S603

    def _end(self) -> None:
        process, self._process = self._process, None
        if process is not None:
            process.kill()
            process.wait()
            for pipe in (process.stdin, process.stdout):
                if pipe is not None:
                    with contextlib.suppress(OSError):
                        pipe.close()
