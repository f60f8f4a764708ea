"""A server that could not restore a session."""

from __future__ import annotations

import sqlite3
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, closing
from pathlib import Path

from tests.whole.client import attached, make_event
from tests.whole.harness import Server

REASON = "it could not be restored: s:1:1: the key 'properties' is missing"


@asynccontextmanager
async def unrestored(specs: Path, data: Path) -> AsyncIterator[Server]:
    """A server with a session `s` of two events, whose spec it refuses now."""
    with Server(specs, data) as first:
        async with attached(first, session="s", spec="single") as monitor:
            await monitor.send(*(make_event(seq, at=seq, data={"v": 11}) for seq in (1, 2)))
            await monitor.acked(2)
        assert first.stop() == 0
    with closing(sqlite3.connect(data / "history.sqlite")) as database, database:
        database.execute("UPDATE sessions SET text = ?", ("id: single\nstreams: 3\n",))
    with Server(specs, data) as second:
        yield second
