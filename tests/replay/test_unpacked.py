"""What is unpacked while a recording is judged: nothing of it is left, however that ends."""

from __future__ import annotations

import gzip
import json
import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import tarfile
import tempfile
from contextlib import closing
from pathlib import Path, PosixPath
from typing import Any

import pytest
import zstandard
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from oracle_server.replay.files import scratch
from oracle_server.replay.many.judging import Task, Unit
from oracle_server.replay.many.workers import Workers
from tests.processes import PATIENCE, ROOT
from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.many.recordings import question

SPEC = """
id: numbers
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
ENDING = """
import os, sys
from oracle_server.cli import main
from oracle_server.replay.bags import bag as bags
from oracle_server.replay.files import folder
number, where = int(sys.argv.pop(1)), sys.argv.pop(1)
place, name = (folder, "_unpack") if where == "unpacking" else (bags, "_oldest")
before = getattr(place, name)
def ending(*arguments):
    found = before(*arguments)
    print("unpacked", flush=True)
    os.kill(os.getpid(), number)
    return found
setattr(place, name, ending)
main()
"""
"""The command, which gets a signal once a file is unpacked, or once it is judged."""


MANY = [(at, float(at)) for at in range(3000)]


@pytest.fixture
def temporary(tmp_path: Path) -> Path:
    folder = tmp_path / "temporary"
    folder.mkdir()
    return folder


def packed(folder: Path, form: str, count: int = 20) -> Path:
    """A bag that must be unpacked: a file that is compressed, or a folder as one file."""
    storage = StoragePlugin.SQLITE3 if form == "db3" else StoragePlugin.MCAP
    bag = write_numbers(folder / "bag", {"/x": [(at, float(at)) for at in range(count)]}, storage)
    if form == "tar":
        with tarfile.open(folder / "bag.tar", "w") as archive:
            archive.add(bag, "bag")
        return folder / "bag.tar"
    (path,) = bag.glob(f"*.{form}")
    target = folder / f"{path.name}.zstd"
    target.write_bytes(zstandard.compress(path.read_bytes()))
    return target


def ended(temporary: Path, number: int, where: str, *words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", ENDING, number, where, "replay", *words]
    return subprocess.run(
        list(map(str, command)), cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False,
        env=os.environ | {"TMPDIR": str(temporary)}, stdin=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_who_is_told_to_end_leaves_nothing(number: signal.Signals, temporary: Path, tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC)
    found = ended(temporary, number, "unpacking", spec, packed(tmp_path, "mcap"))
    assert (found.returncode, found.stdout, found.stderr) == (128 + number, "unpacked\n", "")
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("form", ["mcap", "db3", "tar"])
def test_who_is_killed_while_it_judges_leaves_nothing(form: str, temporary: Path, tmp_path: Path) -> None:
    spec = write_spec(tmp_path, SPEC)
    found = ended(temporary, signal.SIGKILL, "judging", spec, packed(tmp_path, form))
    assert (found.returncode, found.stdout) == (-signal.SIGKILL, "unpacked\n")
    assert list(temporary.iterdir()) == []


def test_what_is_ignored_stays_so(temporary: Path, tmp_path: Path) -> None:
    spec, bag = write_spec(tmp_path, SPEC), packed(tmp_path, "mcap")
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as `nohup` has it for what it starts
    try:
        found = ended(temporary, signal.SIGHUP, "unpacking", spec, bag)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert found.returncode == 0, found.stderr
    assert "20 events" in found.stdout


class Deadly(PosixPath):
    """A recording that kills who opens it again while something of it is unpacked, as where it takes too long."""

    def open(self, *arguments: Any, **options: Any) -> Any:
        if next(Path(tempfile.gettempdir()).iterdir(), None) is not None:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().open(*arguments, **options)


def test_of_a_process_that_is_killed_who_started_it_deletes_what_it_has_unpacked(
    temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(tempfile, "tempdir", None)
    asked = question([write_spec(tmp_path, SPEC)])
    said = list(Workers(asked, 1, None).run([Task(0, Deadly(packed(tmp_path, "mcap")), (0,))]))
    (row,) = next(one.rows for one in said if isinstance(one, Unit))
    assert "was killed" in (row.error or "")
    assert list(temporary.iterdir()) == []


def test_a_small_file_does_not_fill_the_disk(temporary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    monkeypatch.setattr(scratch, "RESERVE", 2**24)
    full = shutil.disk_usage(temporary)._replace(free=2**24 - 1)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    spec, small = write_spec(tmp_path, SPEC), packed(tmp_path, "mcap")
    assert judge(spec, small).summary["events"] == 20  # what is smaller than what is left free is always read
    vast = tmp_path / "vast.mcap.zstd"
    vast.write_bytes(zstandard.compress(small.read_bytes()) + zstandard.compress(bytes(2**26)) * 10)
    with pytest.raises(scratch.NoRoomError, match=r"vast.*: unpacks to more than .*: 17 MiB, and 16 MiB .* left free"):
        judge(spec, vast)
    assert list(temporary.iterdir()) == []


@pytest.mark.parametrize("form", ["mcap", "tar", "tar of what is compressed", "log"])
def test_where_the_disk_is_full_nothing_is_wrong_with_the_recording(form: str, temporary: Path, tmp_path: Path) -> None:
    """A table of results would else have for good what another run would read."""
    spec = write_spec(tmp_path, SPEC)
    path = packed(tmp_path, "db3" if form == "log" else form.partition(" ")[0], 3000)
    if form == "log":
        path = tmp_path / "bag" / "bag.db3"
        path.with_name("bag.db3-wal").write_bytes(bytes(100))
    elif " " in form:
        plain = tmp_path / "bag" / "bag.mcap"
        plain.with_name("bag.mcap.zstd").write_bytes(zstandard.compress(plain.read_bytes()))
        with tarfile.open(path, "w") as archive:
            archive.add(plain.with_name("bag.mcap.zstd"), "bag.mcap.zstd")
    error = error_where_files_are_small(path, spec, temporary)
    assert error.startswith(f"{path}")
    assert error.endswith("can't be unpacked to the folder for temporary files (TMPDIR): File too large")
    assert list(temporary.iterdir()) == []


def test_what_is_put_in_order_on_the_disk_is_no_fault_of_the_recording_either(temporary: Path, tmp_path: Path) -> None:
    """Sqlite does that with many messages that have no index."""
    spec, bag = write_spec(tmp_path, SPEC), write_numbers(tmp_path / "bag", {"/x": MANY}, StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(bag / "bag.db3")) as database, database:
        database.execute("DROP INDEX timestamp_idx")
        database.execute("UPDATE messages SET data = zeroblob(8000)")
    error = error_where_files_are_small(bag, spec, temporary)
    assert "bag.db3: can't be put in order in the folder for temporary files (TMPDIR): " in error


def error_where_files_are_small(path: Path, spec: Path, temporary: Path) -> str:
    """Why a recording is not judged where no file may have more than 40 KiB; the room of a disk is root's alone."""
    limited = ["bash", "-c", 'ulimit -f 40; exec "$0" "$@"', sys.executable, "-m", "oracle_server"]
    ended = subprocess.run(
        [*limited, "replay", str(path), "--on", str(spec), "--format", "jsonl"],
        cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False,
        env=os.environ | {"TMPDIR": str(temporary), "SQLITE_TMPDIR": str(temporary)},
    )  # fmt: skip
    row: dict[str, Any] = json.loads(ended.stdout)
    assert (ended.returncode, row["error_kind"]) == (2, "run"), row
    return str(row["error"])


def test_what_is_compressed_and_no_bag_is_told_by_its_own_name(
    tmp_path: Path, temporary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By how it begins: unpacked it may be more than the disk takes, and that would be told instead."""
    spec = write_spec(tmp_path, SPEC)
    monkeypatch.setattr(tempfile, "tempdir", str(temporary / "missing"))
    for name, content in (("z.jsonl.zst", b'{"topic": "/x", "time": 1}\n'), ("bag.tar.zst", bytes(1024))):
        path = tmp_path / name
        path.write_bytes(zstandard.compress(content))
        with pytest.raises(TraceError) as refused:
            judge(spec, path)
        what = f"is compressed, and holds no file of a bag: decompress it (`zstd -d {name}`), and judge what comes out"
        assert str(refused.value) == f"{path}: {what}"
    monkeypatch.undo()
    broken = tmp_path / "broken.db3.zst"
    broken.write_bytes(zstandard.compress(b"SQLite format 3\0" + bytes(100)))
    with pytest.raises(TraceError) as refused:
        judge(spec, broken)
    assert str(refused.value).startswith(f"{broken}: can't be read as a bag in sqlite3")


def test_what_is_compressed_a_thousand_times_over_is_refused(tmp_path: Path) -> None:
    """Each time over it was unpacked to a file of its own, until Python gave up: that was told as a defect."""
    path = tmp_path / "bag.mcap.zstd"
    plain = write_numbers(tmp_path / "bag", {"/x": [(0, 1.0)]}, StoragePlugin.MCAP)
    content = next(plain.glob("*.mcap")).read_bytes()
    for times in range(1, 1_001):
        content = zstandard.compress(content)
        if times == 2:  # as of a bag that was compressed when it was recorded, and once more when it was kept
            path.write_bytes(content)
            assert not isinstance(judge(write_spec(tmp_path, SPEC), path), str)
    path.write_bytes(content)
    with pytest.raises(TraceError, match=f"^{path}: is compressed more than 8 times over, which no bag is$"):
        judge(write_spec(tmp_path, SPEC), path)


def test_what_other_programs_have_compressed_is_told(tmp_path: Path) -> None:
    for name in ("z.jsonl.gz", "z.jsonl"):  # as `curl` has it that sends a log with `Content-Encoding: gzip`
        path = tmp_path / name
        path.write_bytes(gzip.compress(b'{"topic": "/x", "time": 1}\n'))
        with pytest.raises(TraceError, match="is compressed by gzip, which is not read: decompress it first"):
            judge(write_spec(tmp_path, SPEC), path)
