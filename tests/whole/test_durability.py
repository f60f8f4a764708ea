"""What a commit survives: the end of the process, or a power cut as well."""

from __future__ import annotations

import asyncio
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from oracle_server.history.sqlite.store import Durability, Store
from tests.whole.harness import PATIENCE, failed


@pytest.mark.parametrize(("durability", "synchronous"), [("normal", 1), ("full", 2)])
def test_the_database_waits_for_the_disk_as_is_asked(tmp_path: Path, durability: Durability, synchronous: int) -> None:
    """SQLite waits for the disk at each commit where `synchronous` is 2, and at checkpoints only where it is 1."""
    with closing(Store(tmp_path, durability)) as store:
        assert store._writer.execute("PRAGMA synchronous").fetchone() == (synchronous,)
        assert store._writer.execute("PRAGMA journal_mode").fetchone() == ("wal",)


def test_a_durability_that_there_is_not_is_told(tmp_path: Path) -> None:
    assert "ORACLE_DURABILITY" in failed("serve", "--data-dir", tmp_path, "--port", "0", ORACLE_DURABILITY="off")


async def failing(folder: Path) -> Store:
    """A store that can't write what it was given."""
    store = Store(folder)
    store.start(asyncio.get_running_loop())
    store.execute("UPDATE steps SET seq = ?", (2**64,))
    async with asyncio.timeout(PATIENCE):
        while store.failure is None:
            await asyncio.sleep(0.01)
    return store


async def test_what_can_not_be_written_for_whatever_reason_is_told(tmp_path: Path) -> None:
    store = await failing(tmp_path)
    assert store.failure is not None
    assert "too large" in store.failure
    await asyncio.to_thread(store.close)


async def test_nothing_is_written_behind_what_could_not_be_written(tmp_path: Path) -> None:
    """Where the store is closed meanwhile, a gap in the history would be left."""
    store = await failing(tmp_path)
    store.execute("INSERT INTO monitors VALUES (1, 'm', 'i', '[]', 1, 'wall')", ())
    await asyncio.to_thread(store.close)
    with closing(sqlite3.connect(store.path)) as database:
        assert database.execute("SELECT * FROM monitors").fetchall() == []
