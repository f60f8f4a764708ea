"""Histories on what is mounted read-only, as a robot's card in another machine, or a volume in a container."""

from __future__ import annotations

import asyncio
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from oracle_server.core.errors import HistoryError
from oracle_server.history.copying import run
from oracle_server.history.sqlite.beside import SqliteBeside
from oracle_server.history.sqlite.history import NAME, SqliteHistory
from oracle_server.process.pidfile import PidFile, PidFileError
from tests.chaos.disk import Unmountable, read_only
from tests.history.making import add, opened, step
from tests.history.test_port import collected


@pytest.fixture
async def card(tmp_path: Path) -> Path:
    """A folder with a history of one step, which its server has closed."""
    folder = tmp_path / "card"
    folder.mkdir()
    history = SqliteHistory(folder)
    history.start(asyncio.get_running_loop())
    history.open_session(opened())
    await add(history, step(1))
    await asyncio.to_thread(history.close)
    return folder


@pytest.fixture
def mounted(card: Path) -> Iterator[Path]:
    """The same as it is seen read-only."""
    try:
        with read_only(card) as seen:
            yield seen
    except Unmountable as error:
        pytest.skip(str(error))


def write_on(card: Path) -> None:
    """Have another step in the log beside the file, as of a server that was killed."""
    work = card.with_name("work")
    shutil.copytree(card, work)
    with closing(sqlite3.connect(work / NAME, isolation_level=None)) as database:
        database.execute("UPDATE steps SET why = 'last'")
        for file in work.iterdir():
            shutil.copy(file, card)


async def read(folder: Path) -> list[str | None]:
    history = SqliteBeside(folder)
    history.start(asyncio.get_running_loop())
    found = [step.why for step in await collected(history.steps(1, 0))]
    await asyncio.to_thread(history.close)
    return found


async def test_what_was_closed_is_read_and_copied(mounted: Path, tmp_path: Path) -> None:
    assert len(await read(mounted)) == 1
    run.copy_history(str(mounted), str(tmp_path / "copy.sqlite"))
    with closing(sqlite3.connect(tmp_path / "copy.sqlite")) as database:
        assert database.execute("SELECT count(*) FROM steps").fetchone() == (1,)


async def test_what_a_killed_server_has_left_is_read_to_its_last_commit(
    card: Path, mounted: Path, tmp_path: Path
) -> None:
    write_on(card)
    assert await read(mounted) == ["last"]
    run.copy_history(str(mounted), str(tmp_path / "copy.sqlite"))
    with closing(sqlite3.connect(tmp_path / "copy.sqlite")) as database:
        assert database.execute("SELECT why FROM steps").fetchall() == [("last",)]


async def test_what_can_not_be_read_to_its_end_is_refused(card: Path, mounted: Path, tmp_path: Path) -> None:
    write_on(card)
    (card / f"{NAME}-shm").unlink()
    why = "what was written last is in history.sqlite-wal, which can't be read on what is mounted read-only"
    with pytest.raises(HistoryError, match=why):
        SqliteBeside(mounted)
    with pytest.raises(HistoryError, match=why):
        run.copy_history(str(mounted), str(tmp_path / "copy.sqlite"))


async def test_what_a_server_elsewhere_uses_is_not_copied(card: Path, mounted: Path, tmp_path: Path) -> None:
    """As from a container in which the volume is read-only."""
    server = PidFile(card)
    with pytest.raises(PidFileError, match="a server uses this data directory"):
        run.copy_history(str(mounted), str(tmp_path / "copy.sqlite"))
    server.release()
    run.copy_history(str(mounted), str(tmp_path / "copy.sqlite"))
