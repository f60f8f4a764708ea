"""Folders of ROS 2 bags: what their metadata promises is held against what their files have."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from tests.replay.judging import BASE, judge, write_numbers, write_spec

SPEC = """
id: numbers
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
TOPICS = {"/x": [(at, float(at)) for at in range(20)], "/y": [(5, 1.0)]}
BOTH = [StoragePlugin.MCAP, StoragePlugin.SQLITE3]
QOS = "- history: 3\n  depth: 0\n  reliability: 1\n  durability: 2\n  deadline: {sec: 0, nsec: 0}\n"


def change(bag: Path, before: str, after: str) -> None:
    path = bag / "metadata.yaml"
    text, count = re.subn(before, after, path.read_text())
    assert count
    path.write_text(text)


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    return write_spec(tmp_path, SPEC)


@pytest.fixture(params=BOTH)
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_numbers(tmp_path / "bag", TOPICS, request.param)


@pytest.mark.parametrize("version", [4, 9])
def test_another_quality_of_service_in_the_metadata_does_no_harm(version: int, bag: Path, spec: Path) -> None:
    path = bag / "metadata.yaml"
    document = yaml.safe_load(path.read_text())
    information = document["rosbag2_bagfile_information"]
    information["version"] = version
    for topic in information["topics_with_message_count"]:
        topic["topic_metadata"]["offered_qos_profiles"] = QOS
    path.write_text(yaml.safe_dump(document))
    found = judge(spec, bag)
    assert (found.summary["events"], found.said) == (20, "")
    assert (found.exit, found.strict) == (0, 0)


def test_fewer_events_than_promised_are_said(bag: Path, spec: Path) -> None:
    change(bag, r"message_count: 20", "message_count: 25")
    found = judge(spec, bag)
    assert "/x: 20 of the 25 messages that it should have could be read" in found.said
    assert (found.exit, found.strict) == (0, 3)


def test_none_of_many_promised_is_no_success(bag: Path, spec: Path) -> None:
    change(bag, r"name: /x", "name: /z")
    two = "id: numbers\nstreams: [{topic: /x, signals: {x: msg.data}}, {topic: /z, signals: {z: msg.data}}]\n"
    path = write_spec(spec.parent, two + "properties: [{id: low, formula: '{x: *} -> {x <= 1000}'}]\n")
    found = judge(path, bag)
    assert found.summary["events"] == 20
    assert found.exit == 2
    assert "/z: none of the 20 messages that it should have could be read" in found.said


def test_a_folder_whose_recorder_was_killed_has_no_metadata(bag: Path, spec: Path) -> None:
    (bag / "metadata.yaml").unlink()
    found = judge(spec, bag)
    assert found.summary["events"] == 20
    assert "has no metadata.yaml: its recording was not closed" in found.said
    assert (found.exit, found.strict) == (0, 3)


def test_a_file_that_is_missing_is_said(bag: Path, spec: Path) -> None:
    change(bag, r"(relative_file_paths:\n)( *- )(.*)\n", r"\1\2\3\n\2gone_1.db3\n")
    found = judge(spec, bag)
    assert "gone_1.db3 is missing, which metadata.yaml names" in found.said
    assert (found.exit, found.strict) == (0, 3)


def test_compressed_files_and_messages_are_read(bag: Path, spec: Path, tmp_path: Path) -> None:
    (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    packed = tmp_path / "packed"
    packed.mkdir()
    target = packed / f"{path.name}.zstd"
    target.write_bytes(zstandard.compress(path.read_bytes()))
    text = (bag / "metadata.yaml").read_text().replace(path.name, target.name)
    (packed / "metadata.yaml").write_text(text)
    assert judge(spec, packed).summary["events"] == 20
    assert judge(spec, target).summary["events"] == 20
    target.write_bytes(target.read_bytes()[:-20])
    with pytest.raises(TraceError, match="could not be decompressed"):
        judge(spec, packed)


def without_metadata(folder: Path, storage: StoragePlugin, parts: dict[str, list[int]]) -> Path:
    """The files of a recorder that was killed, by name: each has numbers at as many seconds."""
    killed = folder / "killed"
    killed.mkdir()
    for name, numbers in parts.items():
        bag = write_numbers(folder / name, {"/x": [(n * 1000, float(n)) for n in numbers]}, storage)
        (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
        path.rename(killed / f"{name}{path.suffix}")
    return killed


RISING = """
id: rising
ordering: {by: arrival}
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: rises, formula: 'forall[n, m]. {x: *n} and pre {x: *m} -> *m <= *n'}]
"""


@pytest.mark.parametrize("storage", BOTH)
@pytest.mark.parametrize("names", ["bag_{}", "part{}_of_12", "{}"])
def test_files_without_metadata_are_read_as_they_were_recorded(
    names: str, storage: StoragePlugin, tmp_path: Path
) -> None:
    """The tenth and later ones too, whose names come before the second one's."""
    bag = without_metadata(tmp_path, storage, {names.format(n): [3 * n, 3 * n + 1, 3 * n + 2] for n in range(12)})
    found = judge(write_spec(tmp_path, RISING), bag)
    assert (found.summary["events"], found.exit) == (36, 0)
    assert [row["arrived"] for row in found.rows] == [BASE + n * 10**9 for n in range(36)]


@pytest.mark.parametrize("storage", BOTH)
def test_times_count_more_than_names(storage: StoragePlugin, tmp_path: Path) -> None:
    """As where a recorder began again and named its files anew; one without messages has no time."""
    bag = without_metadata(tmp_path, storage, {"a": [6, 7], "b": [], "c_1": [0, 1], "c_2": [2, 3, 5]})
    found = judge(write_spec(tmp_path, RISING), bag)
    assert (found.summary["events"], found.exit) == (7, 0)
