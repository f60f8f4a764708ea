"""Sessions without a server: a registry over a history in memory, and an outbox that keeps what is sent."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Any

from oracle_server.history.port import History
from oracle_server.process.clock import Clock
from oracle_server.sessions.registry import Registry
from oracle_server.sessions.shares import Shares
from oracle_server.specfiles.library import Library
from oracle_server.wire.errors import WireError
from oracle_server.wire.frames import Outgoing
from oracle_server.wire.incoming import Attach, EventMessage
from tests.processes import PATIENCE

GUARD = """
id: guard
ordering: {by: arrival}
streams:
  - topic: /go
    action: filter
    signals: {speed: msg.speed}
properties:
  - id: slow
    formula: 'not {speed > 3}'
    guards: [/go]
"""


class Standing(Clock):
    """A clock that stands still unless a test lets it go on."""

    def __init__(self) -> None:
        super().__init__()
        self.time = super().now()

    def now(self) -> int:
        return self.time


class Kept:
    """An outbox that keeps what is sent."""

    def __init__(self) -> None:
        self.frames: list[dict[str, Any]] = []
        self._changed = asyncio.Event()

    def send(self, frame: Outgoing) -> None:
        self.frames.append(dict(frame))
        self._changed.set()

    def drop(self, reason: WireError) -> None:
        self.send(reason.frame())

    def finish(self, frame: Outgoing) -> None:
        self.send(frame)

    async def sent(self) -> None:
        pass

    async def reached(self) -> bool:
        return True

    async def expect(self, kind: str, count: int = 1) -> list[dict[str, Any]]:
        """Wait until so many frames of a type were sent: all of these."""
        async with asyncio.timeout(PATIENCE):
            while len(found := [frame for frame in self.frames if frame["type"] == kind]) < count:
                self._changed.clear()
                await self._changed.wait()
        return found


def registry(
    history: History, folder: Path, *specs: str, shares: Shares | None = None, clock: Clock | None = None
) -> Registry:
    """A registry over a history that is started, with these specs."""
    library = Library(None, folder)
    for text in specs:
        spec_id = text.split("id: ", 1)[1].split("\n", 1)[0]
        library.put(spec_id, text)
    history.start(asyncio.get_running_loop())
    return Registry(history, library, clock or Clock(), resume_within=10.0, shares=shares)


def attach(
    session: str, spec: str, monitor: str = "m", instance: str = "i", streams: list[str] | None = None
) -> Attach:
    return Attach(type="attach", monitor=monitor, instance=instance, session=session, spec=spec, streams=streams)


def event(seq: int, stream: str = "/go", *, ask: bool = False, **data: object) -> EventMessage:
    return EventMessage(seq=seq, stream=stream, data=data, ask=ask)
