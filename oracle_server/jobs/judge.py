"""The process that judges one recording, as its frames."""

from __future__ import annotations

import asyncio
import contextlib
from asyncio.subprocess import PIPE
from collections.abc import AsyncGenerator

import msgspec

from oracle_server.core.errors import OracleError
from oracle_server.jobs import judging
from oracle_server.jobs.frames import Frame, Progress, Task
from oracle_server.process.worker import command, unstarted

SILENT = 60.0
"""Seconds without a frame after which the process is taken for dead: it tells twice a second how far it has got."""
STUCK = 600.0
"""Seconds without progress after which a recording is given up."""
_MOST = 2**28
"""Bytes of a frame."""
_encode = msgspec.msgpack.Encoder().encode
_frame = msgspec.msgpack.Decoder[Frame](Frame).decode


class JudgeError(OracleError):
    """A recording that is not judged to its end."""


class Judge:
    """Starts a process for one recording."""

    def __init__(self, task: Task) -> None:
        self._task = task

    async def frames(self) -> AsyncGenerator[Frame, None]:
        """What it tells. The process ends with this, at the latest. Raises `JudgeError` where it stands still."""
        line, env = command(judging.__name__)
        try:
            process = await asyncio.create_subprocess_exec(*line, stdin=PIPE, stdout=PIPE, env=env)
        except OSError as error:
            raise JudgeError(unstarted(error)) from None
        assert process.stdin is not None  # noqa: S101 -- as it was started so
        assert process.stdout is not None  # noqa: S101
        loop = asyncio.get_running_loop()
        try:
            data = _encode(self._task)
            process.stdin.write(len(data).to_bytes(4, "big") + data)
            far, since = None, loop.time()
            while True:
                try:
                    async with asyncio.timeout(SILENT):
                        frame = await _read(process.stdout)
                except TimeoutError:
                    raise JudgeError(f"the process that judges it has said nothing for {SILENT:.0f} s") from None
                if frame is None:
                    return
                if not isinstance(frame, Progress) or (frame.events, frame.read) != far:
                    far, since = (frame.events, frame.read) if isinstance(frame, Progress) else far, loop.time()
                elif loop.time() - since > STUCK:
                    raise JudgeError(f"it has got no further for {STUCK / 60:.0f} minutes")
                yield frame
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.communicate()  # until its pipes are closed, too


async def _read(pipe: asyncio.StreamReader) -> Frame | None:
    """The next frame, None where the process has ended."""
    try:
        size = int.from_bytes(await pipe.readexactly(4), "big")
        if size > _MOST:
            raise JudgeError("what is judged of it at once is too large to be kept: judge it by `oracle-server replay`")
        frame: Frame = _frame(await pipe.readexactly(size))
    except asyncio.IncompleteReadError:
        return None
    return frame
