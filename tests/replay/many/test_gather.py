"""The recordings that paths mean, and what else may be said of many."""

from __future__ import annotations

import gzip
import os
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import OracleError, TraceError
from oracle_server.replay.many.command import Where, run_many
from oracle_server.replay.many.digest import digest, extent
from oracle_server.replay.many.gather import gather
from tests.replay.judging import write_numbers
from tests.replay.many.recordings import write_recordings, write_specs


def test_a_folder_is_its_recordings_by_name(tmp_path: Path) -> None:
    plain = write_recordings(tmp_path / "b", 2)
    (tmp_path / "b" / "notes.txt").write_text("dry run")
    (tmp_path / "b" / ".hidden.jsonl").write_text("{}")
    log = tmp_path / "a.txt"
    log.write_text(plain[0].read_text())
    (tmp_path / "c.bag").write_text("")
    bag = write_numbers(tmp_path / "d", {"/n": [(0, 1.0)]}, StoragePlugin.MCAP)
    split = write_numbers(tmp_path / "e", {"/n": [(0, 1.0)]}, StoragePlugin.MCAP)
    (split / "metadata.yaml").unlink()
    (split / "e.mcap").rename(split / "e_0.mcap")
    loose = write_numbers(tmp_path / "f", {"/n": [(0, 1.0)]}, StoragePlugin.MCAP)
    (loose / "metadata.yaml").unlink()
    (alone,) = loose.glob("*.mcap")
    alone = alone.rename(loose / "morning.mcap")
    os.mkfifo(tmp_path / "pipe")
    found = gather([tmp_path])
    assert found.recordings == [log, *plain, tmp_path / "c.bag", bag, split, alone]
    assert found.others == 2
    assert gather([tmp_path], without=[log]).recordings == found.recordings[1:]


@pytest.mark.parametrize("name", ["night.jsonl.gz", "night.bag.xz", "night.mcap.zip"])
def test_what_was_compressed_is_a_recording_that_can_not_be_used(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It was passed over as no recording, and what else the folder had could be a success."""
    folder = tmp_path / "logs"
    (plain,) = write_recordings(folder, 1)
    (folder / name).write_bytes(gzip.compress(plain.read_bytes()))
    (folder / "map.pgm.gz").write_bytes(gzip.compress(b"P5"))
    assert gather([folder]) == ([folder / name, plain], 1, [])
    assert run_many([folder], write_specs(tmp_path)[:1], None, "text") == 2
    assert f"{folder / name}: is compressed by gzip, which is not read: decompress it first" in capsys.readouterr().out


def test_a_folder_by_a_link_is_said_to_be_passed_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It may lead round in a circle; what is in it was left out without a word."""
    (plain,) = write_recordings(tmp_path / "logs", 1)
    elsewhere, link = tmp_path / "elsewhere", tmp_path / "logs" / "today"
    write_recordings(elsewhere, 2)
    link.symlink_to(elsewhere)
    bag = write_numbers(tmp_path / "d", {"/n": [(0, 1.0)]}, StoragePlugin.MCAP)
    (tmp_path / "logs" / "bag").symlink_to(bag)
    assert gather([tmp_path / "logs"]) == ([tmp_path / "logs" / "bag", plain], 0, [link])
    assert gather([link, tmp_path / "logs"]).links == []
    run_many([tmp_path / "logs"], write_specs(tmp_path)[:1])
    assert f"oracle-server: {link}: is a folder by a link, and passed over: name it, too" in capsys.readouterr().err


def test_bags_of_ros_1_are_recordings_of_their_own(tmp_path: Path) -> None:
    """However their folder is named: `ros2 bag` numbers its files so."""
    folder = tmp_path / "run"
    folder.mkdir()
    bags = [folder / f"run_{number}.bag" for number in range(2)]
    for bag in bags:
        bag.write_bytes(b"#ROSBAG V2.0\n")
    assert gather([folder]).recordings == bags


def test_arguments_keep_their_order_and_are_taken_once(tmp_path: Path) -> None:
    first, second, third = write_recordings(tmp_path / "r", 3)
    assert gather([third, tmp_path / "r" / "*.jsonl", first]).recordings == [third, first, second]
    gone = tmp_path / "gone.bag"
    assert gather([gone]).recordings == [gone]
    for nothing in (tmp_path / "*.bag", tmp_path):
        (tmp_path / "r").rename(tmp_path / ".r") if (tmp_path / "r").exists() else None
        with pytest.raises(TraceError):
            gather([nothing])


def test_a_digest_is_of_what_is_in_a_recording(tmp_path: Path) -> None:
    one = write_numbers(tmp_path / "one", {"/n": [(0, 1.0)]}, StoragePlugin.SQLITE3)
    before = digest(one, extent(one))
    moved = one.rename(tmp_path / "moved")
    assert digest(moved, extent(moved)) == before
    (moved / "more").touch()
    assert digest(moved, extent(moved)) != before


def test_what_would_wait_for_ever_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.bag")
    with pytest.raises(TraceError, match="is neither a file nor a folder"):
        extent(tmp_path / "pipe.bag")


EXTERNAL = """
id: elsewhere
streams:
  - {topic: /speed, signals: {speed: msg.data}}
properties:
  - {id: asked, engine: external, url: 'ws://127.0.0.1:9'}
"""


def test_an_oracle_elsewhere_is_asked_about_one_recording_at_a_time(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    spec, (recording,) = tmp_path / "spec.yaml", write_recordings(tmp_path / "r", 1)
    spec.write_text(EXTERNAL)
    for where, word in ((Where(jobs=2), "-j"), (Where("ray"), "--engine")):
        with pytest.raises(OracleError, match=f"one recording at a time: leave out {word}$"):
            run_many([recording], [spec], where=where)
    assert run_many([recording], [spec]) == 2
    assert "start it first" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"form": "junit"}, "--format junit is for one recording"),
        ({"out": Path("a.txt")}, "--out a.txt: write a name that ends with .parquet, .jsonl, .csv"),
        ({"out": Path("a.csv"), "form": "csv"}, "leave out --format and --json"),
        ({"out": Path("nowhere/a.csv")}, "there is no such folder"),
    ],
)
def test_what_can_not_be_asked_is_told(tmp_path: Path, options: dict[str, object], said: str) -> None:
    specs, recordings = write_specs(tmp_path), write_recordings(tmp_path / "r", 1)
    with pytest.raises(OracleError, match=said):
        run_many(recordings, specs, **options)  # type: ignore[arg-type]


def test_rows_are_told_in_order_without_a_file(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (slow, _), recordings = write_specs(tmp_path), write_recordings(tmp_path / "r", 3)
    assert run_many(recordings[::-1], [slow], form="csv", where=Where(jobs=2)) == 1
    _, *rows = capsys.readouterr().out.splitlines()
    assert [row.split(",")[0] for row in rows] == [str(path) for path in recordings[::-1] for _ in range(2)]
    with pytest.raises(TraceError, match="stands where a spec is expected"):
        run_many(recordings, [recordings[0]])


def test_where_results_go_is_no_recording_by_a_pattern_or_by_its_name(tmp_path: Path) -> None:
    """The second time its own table was judged, could not be read, and the exit status was 2."""
    recordings = write_recordings(tmp_path / "bags", 2)
    specs, out = write_specs(tmp_path), tmp_path / "bags" / "results.jsonl"
    pattern = tmp_path / "bags" / "*.jsonl"
    named = [*recordings, out]  # as a shell writes the pattern out
    statuses = [run_many(paths, specs, out=out) for paths in ([pattern], [pattern], named)]
    assert len(set(statuses)) == 1
    table = out.read_text()
    assert str(out) not in table
    assert all(str(path) in table for path in recordings)
    with pytest.raises(TraceError, match="results go there, as --out says"):
        run_many([out], specs, out=out)
    assert out.read_text() == table
