"""Files that are called as recordings are, and are none: what is said of each, alone and beside files of a bag."""

from __future__ import annotations

import gzip
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from oracle_server.replay.many.command import run_many
from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.writing import SPEC as PUMP
from tests.replay.writing import write_ros1

SPEC = """
id: numbers
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
POINTER = b"version https://git-lfs.github.com/spec/v1\noid sha256:b90a0af442bfc6aaf31d7ae0a361f04d\nsize 990\n"
PULL = "is a pointer of Git LFS, and not the file that it stands for: get that by `git lfs pull`"
STRANGERS = [
    (POINTER, PULL),
    (b"", "is empty"),
    (bytes(3000), "is no file of a bag"),
    (
        b"ULog\x01\x125\x01",
        "is a log of PX4 (ULog), which is not read: make a bag of it first, as by `ulog2rosbag` of pyulog",
    ),
    (gzip.compress(b"x"), "is compressed by gzip, which is not read: decompress it first"),
]


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return write_spec(tmp_path, SPEC)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    written = write_numbers(tmp_path / "bag", {"/x": [(at, float(at)) for at in range(20)]}, StoragePlugin.MCAP)
    (file,) = written.glob("*.mcap")
    file.rename(written / "run_0.mcap")
    (written / "metadata.yaml").unlink()
    return written


@pytest.mark.parametrize("name", ["flight.bag", "flight.mcap", "flight.db3", "flight.jsonl", "log.txt"])
def test_a_pointer_of_git_lfs_is_told_as_one(name: str, spec: Path, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(POINTER)
    with pytest.raises(TraceError, match=PULL):
        judge(spec, path)


def test_what_to_write_for_a_file_in_another_format_is_told_and_is_taken(spec: Path, tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("time,x\n1.0,2\n")
    with pytest.raises(TraceError, match="as CSV, is written as one event a line first: ") as told:
        judge(spec, path)
    line = str(told.value).split("first: ")[1].replace("/odom", "/x").replace('"x":', '"data":')
    path.write_text(line)
    assert judge(spec, path).summary["streams"]["/x"]["events"] == 1


def test_many_recordings_tell_pointers_of_git_lfs(
    spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "bags").mkdir()
    for name in ("one.bag", "two.mcap"):
        (tmp_path / "bags" / name).write_bytes(POINTER)
    assert run_many([tmp_path / "bags"], [spec]) == 2
    assert capsys.readouterr().out.count(PULL) == 2


def test_a_folder_of_pointers_is_told_as_one(spec: Path, bag: Path) -> None:
    (bag / "run_0.mcap").write_bytes(POINTER)
    with pytest.raises(TraceError, match=f"run_0.mcap: {PULL}"):
        judge(spec, bag)


@pytest.mark.parametrize(("content", "why"), STRANGERS, ids=["pointer", "empty", "zeros", "ulog", "gzip"])
def test_a_part_that_is_no_file_of_a_bag_is_not_passed_over_in_silence(
    content: bytes, why: str, spec: Path, bag: Path
) -> None:
    (bag / "run_1.mcap").write_bytes(content)
    found = judge(spec, bag)
    assert found.summary["events"] == 20
    assert f"run_1.mcap: {why}" in found.said.splitlines()
    assert (found.exit, found.strict) == (0, 3)


def test_what_comes_behind_such_a_part_is_degraded(spec: Path, bag: Path) -> None:
    (bag / "run_0.mcap").rename(bag / "run_1.mcap")
    (bag / "run_0.mcap").write_bytes(POINTER)
    found = judge(spec, bag)
    assert all(record["degraded"] for record in found.rows)


def test_a_part_that_was_compressed_by_its_name_is_not_passed_over_in_silence(spec: Path, bag: Path) -> None:
    (bag / "run_1.mcap.gz").write_bytes(gzip.compress((bag / "run_0.mcap").read_bytes()))
    found = judge(spec, bag)
    assert "run_1.mcap.gz: is compressed by gzip, which is not read: decompress it first" in found.said.splitlines()
    assert found.strict == 3


def test_a_bag_of_ros_1_beside_others_is_not_passed_over_in_silence(tmp_path: Path) -> None:
    folder = tmp_path / "bags"
    folder.mkdir()
    write_ros1(folder / "one.bag", 4)
    spec = write_spec(tmp_path, PUMP)
    alone = judge(spec, folder)
    (folder / "two.bag").write_bytes(POINTER)
    found = judge(spec, folder)
    assert found.summary["events"] == alone.summary["events"]
    assert (alone.strict, found.strict) == (0, 3)
    assert f"two.bag: {PULL}" in found.said.splitlines()


@pytest.mark.parametrize(
    ("name", "instead"),
    [
        ("https://example.org/a.bag", ": it is an address; download the file first"),
        ("nowhere/*.bag", ": patterns are for many recordings: `replay 'nowhere/*.bag' --on SPEC…`"),
        ("nowhere.bag", ""),
    ],
)
def test_what_is_no_file_is_told_what_to_do(name: str, instead: str, spec: Path) -> None:
    with pytest.raises(TraceError) as error:
        judge(spec, Path(name))
    assert str(error.value) == f"{Path(name)}: can't be read: No such file or directory{instead}"
