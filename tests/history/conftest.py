"""Histories of every backend, started on the test's own loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Iterator

import pytest

from oracle_server.history.port import History
from tests.history.backends import BACKENDS, Make, make, postgres, relay
from tests.history.reader import shared_reader

__all__ = ["history", "make", "postgres", "relay"]


@pytest.fixture(params=BACKENDS)
async def history(request: pytest.FixtureRequest, make: Make) -> AsyncIterator[History]:
    """An empty history; the same tests run over each backend."""
    made = make(request.param)
    made.start(asyncio.get_running_loop())
    yield made
    await asyncio.to_thread(made.close)


@pytest.fixture(scope="session", autouse=True)
def reader() -> Iterator[None]:
    """One process for all questions."""
    with shared_reader():
        yield
