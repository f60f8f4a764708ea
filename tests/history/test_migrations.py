"""Histories that older versions wrote: they tell what they told, and are gone on with."""

from __future__ import annotations

import asyncio
import os
import sqlite3
import subprocess
from contextlib import closing
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.core.verdicts import Outcome
from oracle_server.history.query import Query
from oracle_server.history.records import MonitorRecord, SessionRecord, stored_revision
from oracle_server.history.sql.schema import STEP_COLUMNS, VERSION
from oracle_server.history.sqlite.history import SqliteHistory
from oracle_server.history.views import View, records
from tests.history.making import PROPERTIES, add, find, opened, revision, step
from tests.history.test_port import collected
from tests.history.test_standing import change, stands, told
from tests.whole.harness import COMMAND, environment

HELD, FALSE = Outcome.CURRENTLY_TRUE, Outcome.CURRENTLY_FALSE
NEWER: dict[int, str | None] = {6: "released", 7: "pending", 8: "row", 9: "row", 10: "row", 11: None}
"""By their formats: the first column of steps that they had not, if any; nor had they those behind it."""
LATER = {"sessions": ("decides", "kind"), "monitors": ("left_at",)}
"""Columns of other tables that formats had from this one on."""
WITH_LATER, WITH_ROWS = 9, 11


async def written(folder: Path, version: int, *more: SessionRecord) -> SqliteHistory:
    """A history of three steps as a version of an older format wrote it, taken over by this one.

    Each further session has a step in the order that decides there.
    """
    older = SqliteHistory(folder)
    older.start(asyncio.get_running_loop())
    older.open_session(opened())
    older.set_monitor(1, MonitorRecord("m", "i", (), attached=False, clock="wall", left=7))
    await add(older, *STEPS)
    for session in more:
        older.open_session(session)
        await add(older, msgspec.structs.replace(step(1), order=session.decides), session=session.number)
    await asyncio.to_thread(older.close)
    with closing(sqlite3.connect(older.path)) as database:
        database.execute("DROP TABLE forgotten")
        first = NEWER[version]
        missing = {
            "steps": STEP_COLUMNS[STEP_COLUMNS.index(first) :] if first else (),
            **(LATER if version < WITH_LATER else {}),
        }
        if version < WITH_ROWS:
            database.execute("DROP INDEX steps_by_seq")
            database.execute("CREATE UNIQUE INDEX steps_by_seq ON steps (session, monitor, seq, ord)")
            database.execute("DROP TABLE episodes")
        for table, columns in missing.items():
            for column in columns:
                database.execute(f"ALTER TABLE {table} DROP COLUMN {column}")
        if version < WITH_LATER:
            database.execute("DROP TABLE blocks")
        database.execute(f"PRAGMA user_version = {version}")
    history = SqliteHistory(folder)
    history.start(asyncio.get_running_loop())
    return history


STEPS = [step(1), step(2, outcomes=(FALSE, HELD), violated=[0]), step(3, kind="tick")]


def test_there_is_a_history_of_each_format_since_steps_are_revised() -> None:
    assert [*NEWER] == [*range(6, VERSION)]


@pytest.mark.parametrize("version", NEWER)
async def test_it_tells_what_it_told(tmp_path: Path, version: int) -> None:
    history = await written(tmp_path, version)
    assert await collected(history.steps(1, 0)) == STEPS
    for view in get_args(View):
        assert await told(history, Query(view=view)) == [r for kept in STEPS for r in records(kept, PROPERTIES)]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("version", NEWER)
async def test_its_steps_can_be_revised(tmp_path: Path, version: int) -> None:
    history = await written(tmp_path, version)
    late = revision(4, change(7, 3, 3, HELD, retracted=True), None, standing={2: stands(HELD, HELD)})
    history.append(1, [stored_revision(4, late)], lambda: None, [late])
    await history.flush()
    assert await told(history, Query(violations=True)) == []
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("version", NEWER)
async def test_its_steps_have_no_open_obligations_and_later_ones_may(tmp_path: Path, version: int) -> None:
    history = await written(tmp_path, version)
    later = msgspec.structs.replace(step(4), pending={1: 3})
    await add(history, later)
    assert await history.step(1, 4) == later
    found, _ = await find(history, opened(), Query())
    assert [r.get("pending") for r in found] == [None] * 7 + [3]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("version", [version for version in NEWER if version < WITH_LATER])
async def test_its_sessions_are_of_robots_and_when_their_monitors_left_is_not_known(
    tmp_path: Path, version: int
) -> None:
    history = await written(tmp_path, version)
    (found,) = await history.open_sessions()
    assert found.kind == "robot"
    assert [(m.attached, m.left) for m in await history.monitors(1)] == [(False, None)]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("version", NEWER)
async def test_it_knows_which_order_decides(tmp_path: Path, version: int) -> None:
    arrival = opened(2, "a")._replace(text="ordering: {by: arrival}", decides="arrival")
    asked = opened(3, "b")._replace(by="arrival", decides="arrival")
    overruled = opened(4, "c")._replace(text="ordering: {by: arrival}", by="both")
    named = opened(5, "d")._replace(text="description: the arrival")
    history = await written(tmp_path, version, arrival, asked, overruled, named)
    assert [await history.session(name) for name in "sabcd"] == [opened(), arrival, asked, overruled, named]
    await asyncio.to_thread(history.close)


@pytest.mark.parametrize("version", [0, 1, 5, VERSION])
def test_a_database_of_another_program_is_refused_and_left_as_it_is(tmp_path: Path, version: int) -> None:
    """Others count their versions in the same place, and a file of theirs may have the same name."""
    file = tmp_path / "history.sqlite"
    with closing(sqlite3.connect(file)) as database:
        database.executescript(f"CREATE TABLE visits (id INTEGER, at INTEGER); PRAGMA user_version = {version};")
    before = file.read_bytes()
    with pytest.raises(HistoryError, match="is a database of another program"):
        SqliteHistory(tmp_path)
    assert file.read_bytes() == before
    assert [path.name for path in tmp_path.iterdir()] == ["history.sqlite"]


def test_a_disk_that_is_full_is_told_as_what_it_may_be(tmp_path: Path) -> None:
    """SQLite can't make the index of its log then, and says no more than `disk I/O error`."""
    SqliteHistory(tmp_path).close()
    limited = ["sh", "-c", 'ulimit -f 8; exec "$@"', "sh", str(COMMAND), "serve", "--data-dir", str(tmp_path)]
    ended = subprocess.run(
        limited, capture_output=True, encoding="utf-8", env=environment(ORACLE_PORT="0"), check=False
    )
    assert (ended.returncode, ended.stdout) == (2, "")
    assert "history.sqlite: can't be used as a database: disk I/O error: the disk fails, is full, or " in ended.stderr


def test_a_pipe_in_its_place_is_refused_at_once(tmp_path: Path) -> None:
    """To read it would wait for who writes to it, without an end."""
    pipe = tmp_path / "history.sqlite"
    os.mkfifo(pipe)
    pipe.chmod(0o666)
    with pytest.raises(HistoryError, match=r"history\.sqlite: can't be used as a database: it is no file"):
        SqliteHistory(tmp_path)
    assert pipe.stat().st_mode & 0o777 == 0o666, "a device, as /dev/null, is left to all"
