"""Sessions that go on from a snapshot."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest

from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts


@pytest.mark.parametrize("usable", [True, False])
async def test_a_restart_goes_on_from_the_snapshot_and_else_judges_all_again(start: Starts, usable: bool) -> None:
    server = start()
    async with attached(server, session="s", spec="remembers") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"id": i}) for i in range(1, 10)))
        await monitor.acked(9)
    before = server.get("sessions/s")["properties"]
    assert server.stop() == 0
    _spoil(server.data, snapshot=not usable)
    server = start()
    if usable:
        assert server.get("sessions/s")["properties"] == before
    async with attached(server, session="s") as monitor:
        await monitor.send(make_event(10, at=10, data={"again": 3}), make_event(11, at=11, data={"again": 12}))
        await monitor.acked(11)
    records = [r for r in server.records("s") if r["step"] in (10, 11)]
    assert [r["n"] for r in records] == [19, 20, 21, 22], "numbers go on without a gap"
    known, latched = ("currently_true", "false") if usable else ("currently_false", "currently_true")
    assert [r["outcome"] for r in records] == [known, latched, "currently_false", latched]


async def test_a_snapshot_without_the_monitors_numbers_is_gone_on_from(start: Starts) -> None:
    """One of an older format: all that came before is still in the history."""
    server = start()
    async with attached(server, session="s", spec="remembers") as monitor:
        await monitor.send(*(make_event(i, at=i, data={"id": i}) for i in range(1, 10)))
        await monitor.acked(9)
    assert server.stop() == 0
    with sqlite3.connect(server.data / "history.sqlite") as database:
        assert database.execute("SELECT settled FROM snapshots").fetchone()[0] > 0
        database.execute("UPDATE snapshots SET settled = 0, numbers = NULL")
    database.close()
    server = start()
    async with attached(server, session="s") as monitor:
        assert monitor.attached["next"] == 10
        await monitor.send(make_event(9, at=9, data={"again": 3}), make_event(10, at=10, data={"again": 3}))
        await monitor.acked(10)
    assert [(r["n"], r["outcome"]) for r in server.records("s", after=18)][:1] == [(19, "currently_true")]


def _spoil(data: Path, *, snapshot: bool) -> None:
    """Make the stored steps say nothing, so that only a snapshot tells what was; and that too, where wanted."""
    with sqlite3.connect(data / "history.sqlite") as database:
        database.execute("UPDATE steps SET signals = '{}'")
        if snapshot:
            database.execute("UPDATE snapshots SET data = '{\"judges\": {}}'")
    database.close()
