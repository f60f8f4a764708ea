"""Bags in sqlite3 whose recorder was killed: a part of their messages is in a log beside the database."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.replay.command import run_replay
from oracle_server.replay.many.digest import digest, extent
from tests.replay.judging import BASE, MS, write_numbers
from tests.replay.many.recordings import judged, question

SPEC = """
id: low
ordering: {by: arrival}
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {v: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {v < 5}'}]
"""


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "spec.yaml"
    path.write_text(SPEC)
    return path


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A folder with a database of ten messages, and ten more in its log, which alone violate."""
    whole = write_numbers(tmp_path / "whole", {"/x": [(n, 1.0) for n in range(10)]}, StoragePlugin.SQLITE3)
    (source,) = whole.glob("*.db3")
    folder = tmp_path / "bag"
    folder.mkdir()
    with closing(sqlite3.connect(source)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        number, data = database.execute("SELECT topic_id, data FROM messages").fetchone()
        nine = data[:4] + b"\0\0\0\0\0\0\x22\x40"
        rows = [(number, BASE + n * MS, nine) for n in range(10, 20)]
        database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()
        shutil.copyfile(source, folder / "bag_0.db3")
        shutil.copyfile(f"{source}-wal", folder / "bag_0.db3-wal")
    return folder


@pytest.mark.parametrize("inside", ["", "bag_0.db3"])
def test_it_is_judged_with_its_log_and_left_as_it_is(inside: str, bag: Path, spec: Path) -> None:
    recording = bag / inside
    before = extent(bag), digest(bag, extent(bag))
    (row,) = judged(question([spec]), recording)
    assert (row.error, row.events, row.exit) == (None, 20, 1)
    assert (row.violations or 0) > 0
    assert run_replay([spec], recording, None, "text") == 1
    assert (extent(bag), digest(bag, extent(bag))) == before


def test_what_a_log_has_is_a_part_of_the_recording(bag: Path, tmp_path: Path) -> None:
    path, log = bag / "bag_0.db3", bag / "bag_0.db3-wal"
    with_log = digest(path, extent(path))
    assert extent(path).size == path.stat().st_size + log.stat().st_size
    other = shutil.copytree(bag, tmp_path / "other") / "other.db3"
    (tmp_path / "other" / "bag_0.db3").rename(other)
    (tmp_path / "other" / "bag_0.db3-wal").rename(f"{other}-wal")
    assert digest(other, extent(other)) == with_log, "whatever the two are called"
    log.write_bytes(log.read_bytes()[:-4096])
    assert digest(path, extent(path)) != with_log
    log.write_bytes(b"")
    without = digest(path, extent(path))
    assert without != with_log
    log.unlink()
    assert digest(path, extent(path)) == without


def test_of_a_log_without_anything_in_it_what_the_database_has_is_judged(bag: Path, spec: Path) -> None:
    log = bag / "bag_0.db3-wal"
    log.write_bytes(b"no log at all" * 400)
    (row,) = judged(question([spec]), bag)
    assert (row.error, row.events) == (None, 10)
