"""A server that looks whether others are gone, while the history can be written and not read."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Collection
from pathlib import Path

import pytest
from structlog.testing import capture_logs

from oracle_server.core.errors import UnansweredError
from oracle_server.history.memory import MemoryHistory
from oracle_server.history.records import SessionRecord
from oracle_server.sessions.sharing import share
from tests.sessions.making import GUARD, registry


async def test_it_is_told_once_that_it_can_not_be_seen_whether_others_are_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, looks, enough = MemoryHistory(), 0, asyncio.Event()

    async def fails_but_once(known: Collection[int]) -> list[SessionRecord]:
        nonlocal looks
        looks += 1
        if looks == 7:
            enough.set()
        if looks == 4:
            return []
        raise UnansweredError("PostgreSQL: sorry, too many clients already")

    monkeypatch.setattr(history, "take_over", fails_but_once)
    with capture_logs() as told:
        looking = asyncio.create_task(share(registry(history, tmp_path, GUARD), history, 0))
        await enough.wait()
        looking.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await looking
    assert [line["reason"] for line in told if line["log_level"] == "warning"] == [
        "PostgreSQL: sorry, too many clients already"
    ] * 2
