"""Histories of every backend, started on the test's own loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.history.port import History
from oracle_server.history.sqlite.history import SqliteHistory

BACKENDS: dict[str, Callable[[Path], History]] = {
    "sqlite": SqliteHistory,
    "memory": lambda _: MemoryHistory(),
}


@pytest.fixture(params=sorted(BACKENDS))
async def history(request: pytest.FixtureRequest, tmp_path: Path) -> AsyncIterator[History]:
    """An empty history; the same tests run over each backend."""
    made = BACKENDS[request.param](tmp_path)
    made.start(asyncio.get_running_loop())
    yield made
    await asyncio.to_thread(made.close)
