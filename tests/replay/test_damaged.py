"""Damaged recordings: judged as far as they go, or refused in one line; what was lost is said either way."""

from __future__ import annotations

import random
import re
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path

import pytest
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from oracle_server.core.spec import Spec
from oracle_server.replay.command import run_replay
from oracle_server.replay.conclusion import UNJUDGED, UNUSABLE
from oracle_server.replay.files.blocks import Block
from oracle_server.replay.files.mcapfile import McapFile
from oracle_server.replay.files.storage import Message
from oracle_server.replay.opening import open_recording
from oracle_server.specfiles.load import load_spec
from tests.replay.fuzzing import DAMAGES, damage, judge, rewrite, whole_files
from tests.replay.judging import BASE, write_numbers, write_spec
from tests.replay.judging import judge as judged
from tests.replay.writing import SPEC, write_ros1

NUMBERS = """
id: numbers
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {x <= 1000}'}]
"""
MANY = [(at, float(at)) for at in range(200)]


@pytest.fixture
def numbers(tmp_path: Path) -> Spec:
    return load_spec(write_spec(tmp_path, NUMBERS)).spec


def events(spec: Spec, path: Path) -> int:
    return sum(1 for _ in open_recording(path, spec))


def test_nothing_that_is_damaged_is_judged_without_a_word(tmp_path: Path) -> None:
    """No damage raises anything, and where events are missing it is said."""
    (tmp_path / "pump.yaml").write_text(SPEC)
    spec = load_spec(tmp_path / "pump.yaml").spec
    sources = whole_files(tmp_path)
    files = [path.read_bytes() for path in sources if path.is_file()]
    wholes = {path: events(spec, path) for path in sources}
    tried: Counter[str] = Counter()
    for number in range(300):
        chance = random.Random(number)
        source = chance.choice(sources)
        found = judge(spec, damage(source, tmp_path / "damaged", chance, chance.choice(files)))
        tried[source.name] += 1
        if isinstance(found, str):
            assert "\n" not in found
            continue
        judged = sum(counts["events"] for counts in found.coverage.values())
        lost = judged < wholes[source]
        assert not lost or found.status == UNUSABLE or found.doubts or found.unjudged, (number, source)
    assert len(tried) == len(sources)
    assert len(DAMAGES) == 4


@pytest.mark.parametrize("form", [CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def test_an_mcap_of_a_robot_that_lost_its_power_is_judged_as_far_as_it_goes(
    form: CompressionType, numbers: Spec, tmp_path: Path
) -> None:
    bag = write_numbers(tmp_path / "bag", {"/x": MANY, "/y": MANY}, StoragePlugin.MCAP)
    path = rewrite(next(bag.glob("*.mcap")), tmp_path / "cut.mcap", form)
    whole = path.read_bytes()
    assert events(numbers, path) == len(MANY)
    before = len(MANY)
    for part in (9, 6, 3):
        path.write_bytes(whole[: len(whole) * part // 10])
        found = judge(numbers, path)
        assert not isinstance(found, str)
        (counts,) = found.coverage.values()
        assert 0 < counts["events"] <= before
        before = counts["events"]
        assert any("ends early" in doubt for doubt in found.doubts)
    assert before < len(MANY)


def test_an_mcap_whose_end_is_all_zeros_is_read_up_to_them(numbers: Spec, tmp_path: Path) -> None:
    """Each nine of them were taken for a record, minutes for what a disk had room for when the power went."""
    bag = write_numbers(tmp_path / "bag", {"/x": MANY}, StoragePlugin.MCAP)
    path = rewrite(next(bag.glob("*.mcap")), tmp_path / "zeros.mcap", CompressionType.ZSTD)
    with closing(McapFile(path)) as file:
        chunk = max(block.offset + block.length for block in file._blocks)
    data = path.read_bytes()
    path.write_bytes(data[:chunk] + bytes(9_000))
    found = judge(numbers, path)
    assert not isinstance(found, str)
    assert f"zeros.mcap: ends early, in the record at byte {chunk} of {chunk + 9_000}" in found.doubts
    (counts,) = found.coverage.values()
    assert counts["events"] == len(MANY)


def test_that_a_file_ends_early_is_said_whatever_else_is_wrong_with_it(numbers: Spec, tmp_path: Path) -> None:
    """It was left out behind a channel that the file tells twice, as one that was put together of two."""
    path = tmp_path / "cut.mcap"
    with path.open("wb") as out:
        writer = Writer(out, use_chunking=False)
        writer.start()
        first, second = (writer.register_channel(topic, "cdr", 0) for topic in ("/x", "/y"))
        for at in range(10):
            writer.add_message(first, BASE + at, bytes(12), BASE + at)
        writer.finish()  # type: ignore[no-untyped-call]
    data = path.read_bytes()
    at = data.index(b"/y") - 8  # the number of the second channel becomes the first one's
    assert second == int.from_bytes(data[at : at + 2], "little")
    path.write_bytes((data[:at] + first.to_bytes(2, "little") + data[at + 2 :])[:-300])
    with closing(McapFile(path)) as file:
        said = " ".join(file.damages)
    assert "tells two topics of channel" in said
    assert "ends early" in said


def test_many_messages_without_a_time_are_told_without_looking_at_all_for_each(tmp_path: Path) -> None:
    """Ten thousand took 18 s."""
    path = tmp_path / "times.mcap"
    with path.open("wb") as out:
        writer = Writer(out, use_chunking=False)
        writer.start()
        channel = writer.register_channel("/x", "cdr", 0)
        for at in range(1_000):
            writer.add_message(channel, 2**63 + at, bytes(12), 2**63 + at)
        writer.finish()  # type: ignore[no-untyped-call]
    looked = 0

    class Looked(str):
        __slots__ = ()

        def startswith(self, *_: object) -> bool:
            nonlocal looked
            looked += 1
            return False

    class Damages(list[str]):
        def append(self, damage: str) -> None:
            super().append(Looked(damage))

    with closing(McapFile(path)) as file:
        file.damages = Damages()
        assert [*file.messages([channel])] == []
        assert len(file.damages) == 1_000
    assert looked == 0


@pytest.mark.parametrize(
    ("at", "wrong", "said"),
    [
        (25, (2**40).to_bytes(8, "little"), "says that it unpacks to 1099511627776 bytes"),
        (41, b"zstf", "is compressed by 'zstf'"),
    ],
)
def test_a_chunk_that_can_not_be_unpacked_is_told(
    numbers: Spec, tmp_path: Path, at: int, wrong: bytes, said: str
) -> None:
    bag = write_numbers(tmp_path / "bag", {"/x": MANY}, StoragePlugin.MCAP)
    path = rewrite(next(bag.glob("*.mcap")), tmp_path / "wrong.mcap", CompressionType.ZSTD)
    data = bytearray(path.read_bytes())
    chunk = data.index(b"zstd") - 41
    data[chunk + at : chunk + at + len(wrong)] = wrong
    path.write_bytes(data)
    found = judge(numbers, path)
    assert not isinstance(found, str)
    assert any(f"the part at byte {chunk + 9} {said}" in doubt for doubt in found.doubts), found.doubts


def test_a_chunk_that_differs_from_its_checksum_is_left_out_and_said(numbers: Spec, tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", {"/x": MANY}, StoragePlugin.MCAP)
    path = rewrite(next(bag.glob("*.mcap")), tmp_path / "flipped.mcap", CompressionType.NONE)
    data = bytearray(path.read_bytes())
    at = data.index(b"\x00\x01\x00\x00", len(data) // 4)  # the heading of a message
    data[at + 5] ^= 0xFF
    path.write_bytes(data)
    found = judge(numbers, path)
    assert not isinstance(found, str)
    (counts,) = found.coverage.values()
    assert 0 < counts["events"] < len(MANY)
    assert any("differs from its checksum" in doubt for doubt in found.doubts)
    assert any(f"{counts['events']} of the {len(MANY)} messages" in doubt for doubt in found.doubts)


@pytest.mark.parametrize("cut", [0, 1, 30])
def test_messages_outside_chunks_are_in_their_order_whatever_stands_between_them(
    cut: int, numbers: Spec, tmp_path: Path
) -> None:
    """A channel that was found late, and what is left of a message at the end, have no time."""
    path = tmp_path / "fast.mcap"
    with path.open("wb") as out:
        writer = Writer(out, use_chunking=False)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data")
        other = writer.register_channel("/y", "cdr", schema)
        for at in range(30):
            if at == 25:
                found = writer.register_channel("/x", "cdr", schema)
            if at >= 25:
                writer.add_message(found, BASE + at, b"\0\1\0\0" + bytes(8), BASE + at)
            writer.add_message(other, BASE + at, bytes(100_000), BASE + at)
        end = out.tell()
        writer.finish()  # type: ignore[no-untyped-call]
    path.write_bytes(path.read_bytes()[: end - 100_000 - cut] if cut else path.read_bytes())
    file = McapFile(path)
    times = [at for _, at, *_ in file.messages({found, other})]
    assert (file.oldest, file.newest) == (BASE, times[-1])
    file.close()
    assert times == sorted(times)
    assert len(times) >= 33
    assert len({recorded.event.arrived for recorded in open_recording(path, numbers)}) == 5


@pytest.mark.parametrize("damaged", [False, True])
def test_when_a_file_ends_is_known_without_reading_all_of_it(
    damaged: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Of a bag with many files, those that have nothing that is judged may be most of it."""
    path, starts = tmp_path / "parts.mcap", list[int]()
    with path.open("wb") as out:
        writer = Writer(out, chunk_size=1, compression=CompressionType.NONE)
        writer.start(profile="ros2", library="test")
        channel = writer.register_channel("/y", "cdr", writer.register_schema("std_msgs/msg/Float64", "ros2msg", b""))
        for at in range(30):
            starts.append(out.tell())
            writer.add_message(channel, BASE + at, bytes(12), BASE + at)
        writer.finish()  # type: ignore[no-untyped-call]
    if damaged:
        data = bytearray(path.read_bytes())
        data[starts[-1] + 9 + 28] ^= 0xFF  # in the last chunk's checksum
        path.write_bytes(data)
    file, read = McapFile(path), list[int]()
    in_block = McapFile._in_block

    def counted(self: McapFile, block: Block, wanted: Collection[int] | None) -> Iterator[Message]:
        read.append(block.start)
        return in_block(self, block, wanted)

    monkeypatch.setattr(McapFile, "_in_block", counted)
    assert file.newest == BASE + 29 - damaged
    file.close()
    assert read == [BASE + 29, BASE + 28][: 1 + damaged]


def test_a_ros1_bag_that_was_not_closed_is_judged_as_far_as_it_goes(tmp_path: Path) -> None:
    (tmp_path / "pump.yaml").write_text(SPEC)
    spec = load_spec(tmp_path / "pump.yaml").spec
    (bag,) = (path for path in whole_files(tmp_path) if path.suffix == ".bag")
    whole = events(spec, bag)
    data = bag.read_bytes()
    bag.write_bytes(data[: len(data) // 2])
    found = judge(spec, bag)
    assert not isinstance(found, str)
    assert 0 < sum(counts["events"] for counts in found.coverage.values()) < whole
    cut = rf"ends early, in the record at byte \d+ of {len(data) // 2}: the bag was not closed"
    assert any(re.search(cut, doubt) for doubt in found.doubts)


def test_a_log_that_ends_within_a_line_is_judged_as_far_as_it_goes(numbers: Spec, tmp_path: Path) -> None:
    log = tmp_path / "log.jsonl"
    line = '{"stream": "/x", "stamp": 1, "arrived": 1, "data": {"data": 1}}\n'
    log.write_text(line * 3 + line[:30])
    found = judge(numbers, log)
    assert not isinstance(found, str)
    assert sum(counts["events"] for counts in found.coverage.values()) == 3
    assert any("log.jsonl:4: ends early" in doubt for doubt in found.doubts)
    log.write_text(line + line[:30] + "\n" + line)
    assert isinstance(judge(numbers, log), str)


def test_verdicts_after_a_loss_are_degraded(numbers: Spec, tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", {"/x": MANY[:20]}, StoragePlugin.MCAP)
    (path,) = bag.glob("*.mcap")
    data = bytearray(path.read_bytes())
    with AnyReader([path]) as reader:
        payloads = [bytes(raw) for _, _, raw in reader.messages()]
    second = data.index(payloads[1])
    data[second : second + 2] = b"\x77\x77"
    path.write_bytes(data)
    lost = [recorded.event.lost for recorded in open_recording(path, numbers)]
    assert lost == [0, 1] + [0] * 17


BOTH = """
id: both
streams:
  - {topic: /x, type: std_msgs/msg/Float64, signals: {x: msg.data}}
  - {topic: /y, type: std_msgs/msg/Float64, signals: {y: msg.data}}
properties:
  - {id: low, formula: '{topic: "/x"} -> {x <= MOST}'}
  - {id: other, formula: '{topic: "/y"} -> {y <= 1000}'}
"""


@pytest.mark.parametrize(("most", "status"), [(1000, 3), (5, 1)])
def test_what_reads_messages_of_which_some_can_not_be_read_is_not_judged(
    most: int, status: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A violation among the others is one all the same."""
    bag = write_numbers(tmp_path / "bag", {"/x": MANY[:20], "/y": MANY[:20]}, StoragePlugin.MCAP)
    (path,) = bag.glob("*.mcap")
    data = path.read_bytes()
    with AnyReader([path]) as reader:
        ninth = [bytes(raw) for connection, _, raw in reader.messages() if connection.topic == "/x"][8]
    path.write_bytes(data.replace(ninth, b"\x77\x77" + ninth[2:], 1))
    spec = write_spec(tmp_path, BOTH.replace("MOST", str(most)))
    text = "/x: 1 of its 20 messages could not be read: it is no CDR that is read: it begins with the bytes 77 77"
    found = judge(load_spec(spec).spec, path)
    assert not isinstance(found, str)
    assert found.status == status
    assert found.unjudged == ({"low": text} if status == 3 else {})
    assert [*found.unjudged.values(), *found.doubts].count(text) == 1
    for form in ("text", "junit", "github"):
        assert run_replay([spec], path, None, form) == status
        said = "".join(capsys.readouterr())
        assert text in said
        assert form != "junit" or status != 3 or f'<error message="{text}' in said


def test_a_topic_of_which_nothing_can_be_read_is_no_success(numbers: Spec, tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", {"/x": MANY[:20]}, StoragePlugin.MCAP)
    (path,) = bag.glob("*.mcap")
    data = path.read_bytes()
    with AnyReader([path]) as reader:
        for _, _, raw in reader.messages():
            data = data.replace(bytes(raw), b"\x77\x77" + bytes(raw)[2:])
    path.write_bytes(data)
    found = judge(numbers, path)
    assert not isinstance(found, str)
    assert found.status == UNUSABLE
    assert any("none of its 20 messages could be read as std_msgs/msg/Float64" in text for text in found.unusable)


def test_whole_bags_are_read_as_another_reader_reads_them(tmp_path: Path) -> None:
    (tmp_path / "pump.yaml").write_text(SPEC)
    spec = load_spec(tmp_path / "pump.yaml").spec
    for path in whole_files(tmp_path):
        if path.suffix == ".jsonl":
            continue
        with AnyReader([path]) as reader:
            wanted = [c for c in reader.connections if c.topic in ("/pump", "/limit")]
            expected = [(c.topic, at) for c, at, _ in reader.messages(wanted)]
        found = [(r.event.stream.name, r.event.arrived) for r in open_recording(path, spec)]
        assert found == expected, path


def test_an_empty_file_is_none(numbers: Spec, tmp_path: Path) -> None:
    for name in ("x.bag", "x.mcap", "x.db3", "x"):
        (tmp_path / name).write_bytes(b"")
        with pytest.raises(TraceError, match="is empty"):
            open_recording(tmp_path / name, numbers)


def test_a_file_that_was_appended_to_another_is_said(tmp_path: Path) -> None:
    """What stands behind the end of an MCAP file is no part of it, and its messages are not judged."""
    paths = [write_numbers(tmp_path / name, {"/x": MANY[:5]}, StoragePlugin.MCAP) for name in ("one", "other")]
    one, other = (next(path.glob("*.mcap")).read_bytes() for path in paths)
    path = tmp_path / "both.mcap"
    path.write_bytes(one + other)
    found = judge(load_spec(write_spec(tmp_path, NUMBERS)).spec, path)
    assert not isinstance(found, str)
    assert (found.status, len(found.doubts)) == (UNJUDGED, 1)
    assert found.doubts[0].startswith(f"both.mcap: has {len(other)} bytes behind its end that were not read")


@pytest.mark.parametrize("lacking", [0, 1])
def test_bytes_between_the_chunks_of_a_bag_and_its_index_are_no_damage(lacking: int, tmp_path: Path) -> None:
    """Some that are published have them, and each reader goes by the index; they are where a chunk is lacking."""
    path, spec = write_ros1(tmp_path / "pump.bag", 30), write_spec(tmp_path, SPEC)
    data = bytearray(path.read_bytes())
    at, chunks = (data.index(name) + len(name) for name in (b"index_pos=", b"chunk_count="))
    index = int.from_bytes(data[at : at + 8], "little")
    data[index:index] = bytes(49)
    data[at : at + 8] = (index + 49).to_bytes(8, "little")
    data[chunks] += lacking
    path.write_bytes(data)
    found = judged(spec, path)
    assert found.summary["events"] == 31
    assert ("ends early" in found.said) is bool(lacking)
