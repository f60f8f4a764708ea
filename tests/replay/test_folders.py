"""Folders of ROS 2 bags: what their metadata promises is held against what their files have."""

from __future__ import annotations

import re
import resource
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from tests.replay.judging import BASE, judge, write_numbers, write_spec
from tests.replay.writing import SPEC as PUMP
from tests.replay.writing import write_ros1

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


def parted(bag: Path, *names: str) -> None:
    """A folder without metadata, which has copies of the bag's one file by these names."""
    (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    (bag / "metadata.yaml").unlink()
    for name in names:
        (bag / name).write_bytes(path.read_bytes())
    if path.name not in names:
        path.unlink()


def test_a_part_that_is_missing_between_others_is_said(bag: Path, spec: Path) -> None:
    parted(bag, "run_9.db3", "run_12.db3", "run_10.db3")
    found = judge(spec, bag)
    assert found.summary["events"] == 60
    assert "run_11.db3: is missing, by the numbers of the others" in found.said
    assert (found.exit, found.strict) == (0, 3)
    assert any(record.get("degraded") for record in found.rows), "events behind the gap"


@pytest.mark.parametrize(
    "names", [("north.db3", "south.db3"), ("north_0.db3", "south_1.db3"), ("run_0.db3", "run_00.db3"),
              ("run_0.db3", "run_0.mcap"), ("run_1.db3", "run_20261129.db3")],
)  # fmt: skip
def test_files_that_are_no_parts_of_one_bag_are_said_to_be_judged_as_one(
    names: tuple[str, ...], bag: Path, spec: Path
) -> None:
    parted(bag, *names)
    found = judge(spec, bag)
    assert found.summary["events"] == 40
    assert "has 2 files that are not numbered as the parts of one bag, and no metadata.yaml" in found.said
    assert all(name in found.said for name in names)
    assert (found.exit, found.strict) == (0, 3)


def test_a_file_that_is_missing_is_said(bag: Path, spec: Path) -> None:
    change(bag, r"(relative_file_paths:\n)( *- )(.*)\n", r"\1\2\3\n\2gone_1.db3\n")
    found = judge(spec, bag)
    assert "gone_1.db3: is missing, which metadata.yaml names" in found.said
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
    killed = split(folder, storage, parts)
    (killed / "metadata.yaml").unlink()
    return killed


def split(folder: Path, storage: StoragePlugin, parts: dict[str, list[int]]) -> Path:
    """The files of a recorder, by name, and what describes them all."""
    whole = folder / "whole"
    whole.mkdir()
    names = []
    for name, numbers in parts.items():
        bag = write_numbers(folder / name, {"/x": [(n * 1000, float(n)) for n in numbers]}, storage)
        (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
        names.append(path.rename(whole / f"{name}{path.suffix}").name)
        described = yaml.safe_load((bag / "metadata.yaml").read_text())
    information = described["rosbag2_bagfile_information"]
    information["relative_file_paths"] = names
    information["topics_with_message_count"][0]["message_count"] = sum(map(len, parts.values()))
    (whole / "metadata.yaml").write_text(yaml.safe_dump(described))
    return whole


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-1000])


def empty(path: Path) -> None:
    path.write_bytes(b"")


@pytest.mark.parametrize("storage", BOTH)
@pytest.mark.parametrize("lose", [Path.unlink, empty, cut])
def test_verdicts_after_a_gap_between_files_are_degraded(
    lose: Callable[[Path], None], storage: StoragePlugin, tmp_path: Path
) -> None:
    bag = split(tmp_path, storage, {f"s_{n}": [2 * n, 2 * n + 1] for n in range(4)})
    (path,) = bag.glob("s_1.*")
    lose(path)
    found = judge(write_spec(tmp_path, RISING), bag)
    assert found.strict == 3
    degraded = {(row["arrived"] - BASE) // 10**9: row["degraded"] for row in found.rows}
    assert [at for at, is_degraded in degraded.items() if is_degraded] == [4, 5, 6, 7]
    assert degraded.keys() >= {0, 1, 4, 5, 6, 7}
    assert f"\n{path.name}: " in f"\n{found.said}"


@pytest.mark.parametrize("lost", ["s_0", "s_2"])
def test_a_gap_at_an_end_degrades_what_comes_after_it(lost: str, tmp_path: Path) -> None:
    """Behind the last event that is what time alone decides."""
    text = RISING.replace("formula: 'forall[n, m]. {x: *n} and pre {x: *m} -> *m <= *n'", "ALIVE").replace(
        "ALIVE", "time: seconds, formula: 'once[:1500ms] {topic: /x}'"
    )
    bag = split(tmp_path, StoragePlugin.MCAP, {"s_0": [0, 1], "s_1": [2, 3], "s_2": [4, 5]})
    other = write_numbers(tmp_path / "other", {"/y": [(9000, 1.0)]}, StoragePlugin.MCAP)
    next(other.glob("*.mcap")).rename(bag / "s_3.mcap")
    change(bag, "- s_2.mcap", "- s_2.mcap\n  - s_3.mcap")
    (bag / f"{lost}.mcap").unlink()
    rows = judge(write_spec(tmp_path, text), bag).rows
    assert [row["degraded"] for row in rows] == [lost == "s_0"] * 4 + [True]
    assert rows[-1]["kind"] == "tick"
    assert rows[-1]["violation"]


@pytest.mark.parametrize("storage", BOTH)
def test_a_file_that_the_metadata_does_not_name_is_said(storage: StoragePlugin, tmp_path: Path) -> None:
    """As of a recorder that was killed, and had described what it had closed."""
    bag = split(tmp_path, storage, {"e_0": [0, 1], "e_1": [2], "e_2": [3]})
    change(bag, r"  - e_[12]\..*\n", "")
    change(bag, "message_count: 4", "message_count: 2")
    found = judge(write_spec(tmp_path, RISING), bag)
    suffix = next(bag.glob("e_0.*")).suffix
    assert found.said.splitlines() == [
        f"e_{n}{suffix}: is not named in metadata.yaml, and was not judged" for n in (1, 2)
    ]
    assert (found.exit, found.strict) == (0, 3)


def test_other_files_of_the_folder_are_no_matter(bag: Path, spec: Path) -> None:
    """A copy that is compressed, one in another format, a session's trace, and whatever begins as no bag."""
    (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    (bag / f"{path.name}.zstd").write_bytes(zstandard.compress(path.read_bytes()))
    (bag / "copy.bag").write_bytes(b"#ROSBAG V2.0\n")
    (bag / "notes.mcap").write_text("of the flight")
    (bag / "notes.db3").write_text("of the flight")
    profile = b"oracle-server"
    head = b"\x89MCAP0\r\n\x01" + (8 + len(profile)).to_bytes(8, "little") + len(profile).to_bytes(4, "little")
    (bag / "session.mcap").write_bytes(head + profile + bytes(4))
    found = judge(spec, bag)
    assert (found.exit, found.strict, found.said) == (0, 0, "")


def test_what_is_wrong_with_a_file_is_said_of_it(tmp_path: Path) -> None:
    """Also behind one that could not be opened."""
    bag = split(tmp_path, StoragePlugin.MCAP, {"s_0": [0, 1], "s_1": [2, 3], "s_2": [4, 5]})
    empty(bag / "s_0.mcap")
    cut(bag / "s_1.mcap")
    said = judge(write_spec(tmp_path, RISING), bag).said
    assert "s_0.mcap: is empty" in said
    assert "s_1.mcap: ends early" in said
    assert "s_2.mcap" not in said


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


@pytest.mark.parametrize("described", [True, False])
@pytest.mark.parametrize("storage", BOTH)
def test_files_that_overlap_are_read_by_time(storage: StoragePlugin, described: bool, tmp_path: Path) -> None:
    """As those of two recorders; what one of them lacks degrades nothing before it ends."""
    bag = split(tmp_path, storage, {"s_1": [1, 3, 5], "s_2": [0, 2, 6], "s_3": [4, 8], "s_4": [7]})
    if not described:
        (bag / "metadata.yaml").unlink()
    found = judge(write_spec(tmp_path, RISING), bag)
    assert (found.summary["events"], found.exit) == (9, 0)
    assert [row["arrived"] for row in found.rows] == [BASE + n * 10**9 for n in range(9)]


def test_a_bag_goes_on_until_the_last_message_of_any_file(tmp_path: Path) -> None:
    head, _, _ = RISING.partition("properties")
    text = f"{head}properties: [{{id: alive, time: seconds, formula: 'once[:1500ms] {{topic: /x}}'}}]\n"
    bag = split(tmp_path, StoragePlugin.MCAP, {"s_1": [0, 9], "s_2": [1, 2]})
    other = write_numbers(tmp_path / "other", {"/y": [(0, 1.0), (9000, 1.0)]}, StoragePlugin.MCAP)
    next(other.glob("*.mcap")).replace(bag / "s_1.mcap")
    (bag / "metadata.yaml").unlink()
    rows = judge(write_spec(tmp_path, text), bag).rows
    assert [row["kind"] for row in rows] == ["topic", "topic", "tick"]
    assert rows[-1]["violation"]


@pytest.mark.parametrize("storage", BOTH)
def test_a_bag_may_have_more_files_than_a_process_may_open_at_first(
    storage: StoragePlugin, spec: Path, tmp_path: Path
) -> None:
    """A day's bag that is split each minute has 1,440, and systems let a process open 1,024."""
    bag = split(tmp_path, storage, {f"{at}": [at] for at in range(80)})
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (64, before[1]))
    try:
        found = judge(spec, bag)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert (found.summary["events"], found.said) == (80, "")


@pytest.mark.parametrize("name", ["{}", "./{}", "old/place/{}"])
def test_a_file_that_the_metadata_names_twice_is_read_once(name: str, bag: Path, spec: Path) -> None:
    (path,) = (path.name for path in bag.iterdir() if path.suffix != ".yaml")
    change(bag, f"  - {path}", f"  - {path}\n  - {name.format(path)}")
    found = judge(spec, bag)
    assert (found.summary["events"], found.strict, found.said) == (20, 0, "")


@pytest.mark.parametrize("suffix", ["zstd", "zst"])
def test_a_copy_that_is_compressed_is_not_read_beside_the_file(suffix: str, bag: Path, spec: Path) -> None:
    """As a recorder leaves it that is killed while it compresses: the folder has no metadata yet."""
    (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    whole, copy = zstandard.compress(path.read_bytes()), bag / f"{path.name}.{suffix}"
    copy.write_bytes(whole[:-20])
    (bag / "metadata.yaml").unlink()
    found = judge(spec, bag)
    assert found.summary["events"] == 20
    assert found.said == "has no metadata.yaml: its recording was not closed"
    path.unlink()
    copy.write_bytes(whole)
    assert judge(spec, bag).summary["events"] == 20


@pytest.mark.parametrize("count", [1, 2])
def test_bags_of_ros_1_have_no_metadata(count: int, tmp_path: Path) -> None:
    """Nothing is wrong with one of them; of several nobody knows whether they are one recording."""
    folder = tmp_path / "bags"
    folder.mkdir()
    for number in range(count):
        write_ros1(folder / f"pump_{number}.bag", 30)
    found = judge(write_spec(tmp_path, PUMP), folder)
    assert found.summary["events"] == 31 * count
    assert found.said == ("" if count == 1 else (
        "has 2 bags of ROS 1, which are judged as one that was split; with --on each is one of its own"
    ))  # fmt: skip


def test_recordings_in_folders_of_the_folder_are_said_not_to_be_judged(bag: Path, tmp_path: Path) -> None:
    folder = tmp_path / "bags"
    (folder / "notes").mkdir(parents=True)
    (folder / "notes" / "day.txt").write_text("all went well")
    write_ros1(folder / "pump.bag", 30)
    spec = write_spec(tmp_path, PUMP)
    assert judge(spec, folder).said == ""
    shutil.copytree(bag, folder / "another")
    (folder / "more").mkdir()
    shutil.copy(folder / "pump.bag", folder / "more")
    found = judge(spec, folder)
    assert found.summary["events"] == 31
    assert found.said == (
        "has recordings in 2 folders, which are not judged with its files; with --on each is one of its own: "
        "another, more"
    )


@pytest.mark.parametrize("suffix", [".zstd", ".zst"])
def test_a_file_that_was_compressed_since_is_read(suffix: str, bag: Path, spec: Path) -> None:
    """By hand, to save room: the metadata still has its name without that."""
    (path,) = (path for path in bag.iterdir() if path.suffix != ".yaml")
    path.with_name(f"{path.name}{suffix}").write_bytes(zstandard.compress(path.read_bytes()))
    path.unlink()
    found = judge(spec, bag)
    assert (found.summary["events"], found.exit, found.strict, found.said) == (20, 0, 0, "")


def test_a_file_that_was_decompressed_since_is_read(bag: Path, spec: Path) -> None:
    change(bag, r"(relative_file_paths:\n *- .*)\n", r"\1.zstd\n")
    found = judge(spec, bag)
    assert (found.summary["events"], found.exit, found.strict, found.said) == (20, 0, 0, "")


def test_a_file_is_named_with_its_folder_on_windows(bag: Path, spec: Path) -> None:
    change(bag, r"(relative_file_paths:\n *- )(.*)\n", r"\1bag\\\2\n")
    found = judge(spec, bag)
    assert (found.summary["events"], found.exit, found.strict, found.said) == (20, 0, 0, "")
