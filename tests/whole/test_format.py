"""Histories of other formats: older ones are brought to this one, newer ones are refused, broken ones too."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from oracle_server.history.sql.schema import VERSION
from tests.whole.client import attached, make_event
from tests.whole.conftest import Starts
from tests.whole.harness import failed

OLD = (Path(__file__).parent / "history_of_format_1.sql").read_text()


@pytest.fixture
def history(tmp_path: Path) -> Path:
    (tmp_path / "data").mkdir()
    return tmp_path / "data" / "history.sqlite"


async def test_a_history_of_format_1_is_gone_on_with(history: Path, start: Starts) -> None:
    with closing(sqlite3.connect(history)) as database:
        database.executescript(OLD)
    server = start()
    assert [s["id"] for s in server.get("sessions")["items"]] == ["old", "older"]
    before = server.records("old")
    assert [r["outcome"] for r in before] == ["currently_true"] * 2 + ["currently_false"] + ["currently_true"] * 2
    async with attached(server, session="old") as monitor:
        assert monitor.attached["next"] == 6
        await monitor.send(make_event(6, at=6, data={"v": 77}))
        await monitor.acked(6)
    assert server.records("old")[:5] == before
    assert server.get("sessions/old")["properties"][0]["violations"] == 2
    assert server.stop() == 0
    with closing(sqlite3.connect(history)) as database:
        assert database.execute("PRAGMA user_version").fetchone() == (VERSION,)
    assert len(start().records("old")) == 6


def test_a_migrated_history_has_the_tables_of_a_new_one(history: Path, start: Starts, tmp_path: Path) -> None:
    with closing(sqlite3.connect(history)) as database:
        database.executescript(OLD)
    assert start().stop() == 0
    columns = _columns(history)
    history.unlink()
    assert start().stop() == 0
    assert _columns(history) == columns


def _columns(history: Path) -> dict[str, list[tuple[object, ...]]]:
    """The columns by table, in an order of no meaning but for `monitors`, where rows are written by place."""
    with closing(sqlite3.connect(history)) as database:
        tables = [name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        columns = {t: [row[1:4] for row in database.execute(f"PRAGMA table_info({t})")] for t in tables}
    return {t: found if t == "monitors" else sorted(found) for t, found in columns.items()}


def test_a_newer_history_is_refused_and_left_alone(history: Path, tmp_path: Path) -> None:
    with closing(sqlite3.connect(history)) as database:
        database.execute(f"PRAGMA user_version = {VERSION + 1}")
    before = history.read_bytes()
    assert f"has format {VERSION + 1}" in failed("serve", "--data-dir", tmp_path / "data", "--port", "0")
    assert history.read_bytes()[100:] == before[100:]


def test_a_broken_history_is_refused_in_a_line(history: Path, tmp_path: Path) -> None:
    for content in (b"no database at all, " * 100, b"SQLite format 3\0" + bytes(4000)):
        history.write_bytes(content)
        message = failed("serve", "--data-dir", tmp_path / "data", "--port", "0")
        assert str(history) in message
        assert "can't be used as a database" in message
        assert history.read_bytes() == content
