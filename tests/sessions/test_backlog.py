"""Snapshots bound how much a restart judges again, over all sessions."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from oracle_server.history.memory import MemoryHistory
from oracle_server.sessions import snapshots
from oracle_server.sessions.backlog import Backlog
from tests.processes import PATIENCE
from tests.sessions.making import GUARD, Kept, attach, event, registry


class Fake:
    """A session whose snapshots cost nothing."""

    def __init__(self, backlog: Backlog, *, rested: bool = True) -> None:
        self.rested, self.saved, self._backlog = rested, 0, backlog

    def request(self) -> None:
        self.saved += 1
        self._backlog.count(self, 0)


async def turns() -> None:
    """Let the loop do what was left to it."""
    for _ in range(20):
        await asyncio.sleep(0)


async def test_beyond_the_bound_the_session_with_most_steps_is_saved() -> None:
    backlog = Backlog(1000)
    small, large, busy = (Fake(backlog) for _ in range(3))
    backlog.count(small, 200)
    backlog.count(large, 500)
    backlog.count(busy, 300)
    await turns()
    assert (small.saved, large.saved, busy.saved) == (0, 0, 0)
    backlog.count(busy, 301)
    await turns()
    assert (small.saved, large.saved, busy.saved) == (0, 1, 0)
    assert backlog.total == 501


async def test_a_session_whose_snapshots_take_long_is_passed_over() -> None:
    backlog = Backlog(1000)
    slow, other = Fake(backlog, rested=False), Fake(backlog)
    backlog.count(slow, 5000)
    backlog.count(other, 300)
    await turns()
    assert (slow.saved, other.saved) == (0, 1)
    slow.rested = True
    backlog.count(other, 10)
    await turns()
    assert slow.saved == 1
    assert backlog.total == 10


async def test_a_session_that_is_gone_counts_no_more() -> None:
    backlog = Backlog(1000)
    gone, left = Fake(backlog), Fake(backlog)
    backlog.count(gone, 900)
    backlog.forget(gone)
    backlog.forget(gone)
    backlog.count(left, 900)
    await turns()
    assert (gone.saved, left.saved, backlog.total) == (0, 0, 900)


async def test_of_many_sessions_a_restart_judges_few_steps_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(snapshots, "_REST", 0)
    sessions = registry(MemoryHistory(), tmp_path, GUARD)
    sessions.backlog = Backlog(1000)
    async with asyncio.timeout(PATIENCE):
        for name in "abcdef":
            live, monitor = await sessions.attach(attach(name, "guard"), Kept())
            for seq in range(1, 401):
                live.ingest(monitor, event(seq, speed=1))
            live.ledger.write()
            await turns()
        await sessions.flush()
        assert sessions.backlog.total <= 1000
        open_ones = list(sessions.open.values())
        last = [(await sessions._history.extent(live.number))[1] for live in open_ones]
        saved = [await sessions._history.snapshot(live.number) for live in open_ones]
        positions = [0 if snapshot is None else snapshot.position for snapshot in saved]
        assert last == [400] * 6
        assert sum(last) - sum(positions) == sessions.backlog.total


async def test_steps_of_many_properties_count_as_more(tmp_path: Path) -> None:
    many = GUARD.replace("id: guard", "id: many").split("  - id: slow")[0]
    many += "".join(f"  - {{id: p{i}, formula: 'not {{speed > 3}}', guards: [/go]}}\n" for i in range(35))
    sessions = registry(MemoryHistory(), tmp_path, many)
    async with asyncio.timeout(PATIENCE):
        live, monitor = await sessions.attach(attach("s", "many"), Kept())
        for seq in range(1, 11):
            live.ingest(monitor, event(seq, speed=1))
        live.ledger.write()
        assert sessions.backlog.total == 40


async def test_what_a_restart_left_unsaved_counts_after_it(tmp_path: Path) -> None:
    history = MemoryHistory()
    first = registry(history, tmp_path, GUARD)
    async with asyncio.timeout(PATIENCE):
        live, monitor = await first.attach(attach("s", "guard"), Kept())
        for seq in range(1, 51):
            live.ingest(monitor, event(seq, speed=1))
        live.ledger.save()
        for seq in range(51, 81):
            live.ingest(monitor, event(seq, speed=1))
        live.ledger.write()
        await first.flush()
        second = registry(history, tmp_path, GUARD)
        second.backlog = Backlog(0)
        await second.restore_all()
        await turns()
        assert second.backlog.total == first.backlog.total == 30
        assert await second.closed_within(second.open["s"], PATIENCE)
        assert second.backlog.total == 0
