"""`replay --serve` shows a recording in the dashboard, and leaves nothing behind."""

from __future__ import annotations

import re
import signal
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.cli.showing import show_recording
from oracle_server.core.errors import TraceError
from tests.processes import PATIENCE, ROOT, Process
from tests.replay.judging import BASE, MS, write_numbers, write_spec
from tests.whole.harness import COMMAND, STRICT, environment, failed

SPEC, FAULT = ROOT / "examples/rover/rover.yaml", ROOT / "examples/rover/traces/fault.jsonl"


@pytest.fixture
def showing(tmp_path: Path) -> Iterator[Process]:
    """With settings of a server of one's own, which are not those of this one."""
    settings = environment(
        **STRICT, TMPDIR=str(tmp_path), ORACLE_TOKENS="/nowhere", ORACLE_HISTORY="postgresql://x@127.0.0.1:1/x"
    )
    process = Process("the command", [COMMAND, "replay", "--serve", SPEC, FAULT], settings)
    try:
        yield process
    finally:
        process.remove()


def test_a_recording_is_looked_at_until_ctrl_c(showing: Process, tmp_path: Path) -> None:
    url = showing.said(r"(http://127\.0\.0\.1:\d+)/#/sessions/rover: \d+ events, 3 violations")[1]
    showing.said("Ctrl-C ends it")
    with httpx.Client(base_url=url, timeout=PATIENCE, trust_env=False) as http:
        assert "<title>" in http.get("/").raise_for_status().text
        state = http.get("/api/v1/sessions/rover").json()
        assert (state["kind"], state["recording"]["complete"]) == ("recording", True)
        assert len(http.get("/api/v1/sessions/rover/violations").json()["items"]) == 3
    assert list(tmp_path.iterdir()) != []
    assert showing.end(signal.SIGINT) == 1  # as `replay` ends with
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(httpx.ConnectError):
        httpx.get(url, trust_env=False)
    assert "Traceback" not in showing.log


def test_what_can_not_be_judged_is_told_and_leaves_nothing(tmp_path: Path) -> None:
    other = tmp_path / "other.jsonl"
    other.write_text('{"topic": "/odom", "time": 10}\n', encoding="utf-8")
    (tmp_path / "temporary").mkdir()
    told = failed("replay", "--serve", SPEC, other, TMPDIR=str(tmp_path / "temporary"))
    assert re.search(r"other\.jsonl: has no event of rover", told)
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize("what", ["split", "around a folder", "log", "folder with a log", "promised"])
def test_all_files_of_a_bag_are_judged(what: str, tmp_path: Path) -> None:
    """As `replay` judges them: what a killed recorder has left in the log of its database, too."""
    spec = write_spec(
        tmp_path,
        "id: x\nstreams: [{topic: /x, signals: {x: msg.data}}]\nproperties: [{id: low, formula: 'not {x > 5}'}]",
    )
    bag = write_numbers(tmp_path / "bag", {"/x": [(at, float(at)) for at in range(4)]}, StoragePlugin.SQLITE3)
    trace, told = bag, r"sessions/x: 8 events, 1 violation"
    if what == "promised":
        path = bag / "metadata.yaml"
        path.write_text(path.read_text().replace("message_count: 4", "message_count: 9"))
        told = "/x: 4 of the 9 messages that it should have could be read"
    elif what in ("split", "around a folder"):
        (bag / "metadata.yaml").unlink()
        more = write_numbers(tmp_path / "more", {"/x": [(at, float(at)) for at in range(4, 8)]}, StoragePlugin.SQLITE3)
        (more / "more.db3").rename(bag / "bag_2.db3")
        if what == "around a folder":
            (bag / "pictures").mkdir()
            trace = bag / "pictures" / ".."
    else:
        (bag / "metadata.yaml").unlink()
        with_log(bag / "bag.db3", [(BASE + at * MS, float(at)) for at in range(4, 8)])
        trace = bag / "bag.db3" if what == "log" else bag
    settings = environment(**STRICT, TMPDIR=str(tmp_path))
    process = Process("the command", [COMMAND, "replay", "--serve", spec, trace], settings)
    try:
        process.said(told)
        process.said("Ctrl-C ends it")
        assert process.end(signal.SIGINT) == (0 if what == "promised" else 1)
    finally:
        process.remove()


def with_log(path: Path, numbers: list[tuple[int, float]]) -> None:
    """Have a database's log say more, as where its recorder was killed."""
    with closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA journal_mode = WAL")
        database.execute("PRAGMA wal_autocheckpoint = 0")
        rows = [(1, at, b"\0\1\0\0" + struct.pack("<d", value)) for at, value in numbers]
        database.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        database.commit()
        kept = [(part, part.read_bytes()) for part in (path, path.with_name(f"{path.name}-wal"))]
    for part, data in kept:
        part.write_bytes(data)


def test_a_folder_without_a_bag_is_told(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(TraceError, match="is no recording"):
        show_recording([SPEC], tmp_path, [])


def test_other_options_are_refused() -> None:
    assert "leave out all other options" in failed("replay", "--serve", "--strict", SPEC, FAULT)
