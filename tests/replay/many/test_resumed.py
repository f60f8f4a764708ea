"""A run over many recordings that is ended, in any way, and begun again."""

from __future__ import annotations

import csv
import json
import os
import select
import signal
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple

import pytest

from oracle_server.replay.many.row import COLUMNS
from oracle_server.replay.many.tablefile import read_rows
from tests.forking import STRICT
from tests.processes import FORKS, PATIENCE, ROS_ONLY, environment
from tests.replay.many.recordings import write_recordings, write_specs

COUNT = 60
ENDING = """
import os
os.setsid()
from oracle_server.replay.many.journal import Journal
after, signal = {after}, {ended_by}
add = Journal.add
def counted(self, rows):
    global after
    after -= 1
    if after == 0:
        os.killpg(0, signal) if signal == 2 else os.kill(os.getpid(), signal)
    return add(self, rows)
Journal.add = counted
"""
"""Has the command ended by a signal when it has so many results, as by a terminal's Ctrl-C, or by itself."""


class Ended(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


def replay(*words: object, after: int = 0, ended_by: int = 0) -> Ended:
    """The command, with two processes; it and these have ended."""
    arguments, setting = list(map(str, ("replay", *words, "-j", "2"))), environment(ROS_ONLY, **STRICT)
    out, into = os.pipe()
    with TemporaryFile("w+", encoding="utf-8") as error:
        command = FORKS.fork(arguments, setting, into, error.fileno(), ENDING.format(after=after, ended_by=ended_by))
        os.close(into)
        try:
            said = all_of(out)
            status = command.wait(PATIENCE)
        finally:
            command.kill()
            os.close(out)
        error.seek(0)
        return Ended(status, said, error.read())


def all_of(pipe: int) -> str:
    """What is written to a pipe, until nobody has it any more."""
    parts = []
    while select.select([pipe], [], [], PATIENCE)[0]:
        parts.append(os.read(pipe, 65_536))
        if not parts[-1]:
            return b"".join(parts).decode()
    raise AssertionError("a process has not ended")


def told(path: Path) -> Any:
    """What is in a table, as its own format has it."""
    return path.read_bytes() if path.suffix != ".parquet" else list(read_rows(path))


@pytest.mark.parametrize("form", [".parquet", ".jsonl", ".csv"])
def test_a_run_that_is_killed_twice_comes_to_the_same(tmp_path: Path, form: str) -> None:
    specs, recordings = write_specs(tmp_path), tmp_path / "recordings"
    paths = write_recordings(recordings, COUNT)
    whole, table = tmp_path / f"whole{form}", tmp_path / f"table{form}"
    ended = replay(recordings, "--on", *specs, "--out", whole)
    assert ended.returncode == 2, ended.stderr
    for after in (15, 40):
        killed = replay(recordings, "--on", *specs, "--out", table, after=after, ended_by=signal.SIGKILL)
        assert (killed.returncode, killed.stdout, table.exists()) == (-signal.SIGKILL, "", False)
    journal = tmp_path / f"table{form}.journal"
    there = journal.read_text()
    assert len(there.splitlines()) == 15 + 40 - 2
    journal.write_text(there + there[:100])
    again = replay(recordings, "--on", *specs, "--out", table)
    assert (again.returncode, again.stdout, again.stderr) == (2, ended.stdout, ended.stderr)
    assert told(table) == told(whole)
    rows = list(read_rows(table))
    assert [row.recording for row in rows] == [str(path) for path in paths for _ in range(3)]
    assert sum(row.error is not None for row in rows) == COUNT // 10 * 3
    assert sorted(path.name for path in tmp_path.glob("table*")) == [table.name]


def test_what_is_there_by_digest_is_not_judged_again(tmp_path: Path) -> None:
    slow, _ = write_specs(tmp_path)
    recordings, table = tmp_path / "recordings", tmp_path / "table.jsonl"
    write_recordings(recordings, 10)
    assert replay(recordings, "--on", slow, "--out", table).returncode == 2
    lines = [json.loads(line) for line in table.read_text().splitlines()]
    for line in lines:
        line["events"] = -1 if line["error"] is None else line["events"]
    table.write_text("".join(json.dumps(line) + "\n" for line in lines))
    moved = recordings.rename(tmp_path / "moved")
    changed = moved / "r003.jsonl"
    changed.write_text(changed.read_text().splitlines()[0] + "\n")
    (moved / "r017.jsonl").write_text(changed.read_text())
    assert replay(moved, "--on", slow, "--out", table).returncode == 2
    events = {Path(row.recording).name: row.events for row in read_rows(table)}
    new = {"r003.jsonl": 1, "r017.jsonl": 1, "r007.jsonl": 0}
    assert events == {f"r{i:03}.jsonl": -1 for i in range(10)} | new
    old = (tmp_path / "table.jsonl.old").rename(tmp_path / "old.jsonl")
    assert {Path(row.recording).name for row in read_rows(old)} == {"r003.jsonl"}


def test_other_specs_options_and_an_error_of_the_run_are_judged_anew(tmp_path: Path) -> None:
    slow, rising = write_specs(tmp_path)
    (recording,) = write_recordings(tmp_path / "recordings", 1)
    table, gone = tmp_path / "table.csv", tmp_path / "recordings" / "gone.jsonl"
    first = replay(recording, gone, "--on", slow, "--out", table)
    assert first.returncode == 2
    assert first.stderr == f"oracle-server: {gone}: can't be read: No such file or directory\n"
    gone.write_text(recording.read_text() * 2)
    assert replay(recording, gone, "--on", slow, "--out", table).returncode == 1
    assert [row.events for row in read_rows(table)] == [20, 20, 40, 40]
    assert not (tmp_path / "table.csv.old").exists()
    replay(recording, gone, "--on", slow, rising, "--by", "arrival", "--out", table)
    rows = list(read_rows(table))
    assert [(row.spec, row.order) for row in rows] == [("slow", "arrival")] * 2 + [("rising", "arrival")] + [
        ("slow", "arrival")
    ] * 2 + [("rising", "arrival")]
    slow.write_text(slow.read_text().replace("{speed < 3}", "{speed < 2}"))
    replay(recording, "--on", slow, "--by", "arrival", "--out", table)
    assert {row.spec_digest for row in read_rows(table)}.isdisjoint({row.spec_digest for row in rows})


def test_ctrl_c_ends_it_and_the_next_run_goes_on(tmp_path: Path) -> None:
    specs, recordings, table = write_specs(tmp_path), tmp_path / "recordings", tmp_path / "table.csv"
    write_recordings(recordings, 20)
    ended = replay(recordings, "--on", *specs, "--out", table, after=9, ended_by=signal.SIGINT)
    assert (ended.returncode, ended.stdout) == (130, "")
    assert ended.stderr == (
        f"oracle-server: ended; what was judged is kept in {table}.journal, and the same command goes on\n"
    )
    assert replay(recordings, "--on", *specs, "--out", table).returncode == 2
    with table.open() as file:
        names, *rows = csv.reader(file)
    assert (tuple(names), len(rows)) == (COLUMNS, 60)


def test_one_process_at_a_time_writes_a_table(tmp_path: Path) -> None:
    from oracle_server.replay.many.journal import Journal

    specs, recordings, table = write_specs(tmp_path), tmp_path / "recordings", tmp_path / "table.csv"
    write_recordings(recordings, 1)
    journal = Journal(tmp_path / "table.csv.journal")
    refused = replay(recordings, "--on", *specs, "--out", table)
    journal.close()
    assert (refused.returncode, refused.stderr) == (
        2,
        f"oracle-server: {table}.journal: another `replay` writes these results: wait for it\n",
    )


def test_a_file_that_is_no_table_is_left_as_it_is(tmp_path: Path) -> None:
    specs, recordings = write_specs(tmp_path), tmp_path / "recordings"
    write_recordings(recordings, 1)
    for form in (".parquet", ".jsonl", ".csv"):
        other = tmp_path / f"other{form}"
        other.write_text('{"a": 1}\n')
        refused = replay(recordings, "--on", *specs, "--out", other)
        assert refused.returncode == 2
        assert refused.stderr == (
            f"oracle-server: {other}: is there already, and is no table of results: name another file\n"
        )
        assert other.read_text() == '{"a": 1}\n'
