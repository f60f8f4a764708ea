"""Damages recordings of every format, and judges them: `python -m tests.replay.fuzzing COUNT` for a long campaign."""

from __future__ import annotations

import json
import random
import resource
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin

from oracle_server.core.errors import TraceError
from oracle_server.core.spec import Spec
from oracle_server.replay.conclusion import Conclusion, conclude
from oracle_server.replay.files.mcapfile import McapFile
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import load_spec
from tests.replay.writing import SPEC, write_ros1, write_ros2

ROUNDS = 40


def whole_files(folder: Path) -> list[Path]:
    """A recording of each format, all of the same events: files, and folders with metadata."""
    plain = write_ros2(folder / "plain", StoragePlugin.MCAP, ROUNDS)
    tables = write_ros2(folder / "tables", StoragePlugin.SQLITE3, ROUNDS)
    (mcap,) = plain.glob("*.mcap")
    found = [plain, tables, mcap, next(tables.glob("*.db3")), write_ros1(folder / "old.bag", ROUNDS)]
    found += [
        rewrite(mcap, folder / f"{form.name.lower()}.mcap", form)
        for form in (CompressionType.ZSTD, CompressionType.LZ4)
    ]
    lines = folder / "lines.jsonl"
    at = 1_732_147_200 * 10**9
    events = [{"stream": "/limit", "stamp": at + i, "arrived": at + i, "data": {"data": i}} for i in range(ROUNDS)]
    lines.write_text("".join(json.dumps(event) + "\n" for event in events))
    return [*found, lines]


def rewrite(source: Path, path: Path, form: CompressionType, chunk: int = 1024) -> Path:
    """An MCAP file again, with small chunks that are compressed."""
    file = McapFile(source)
    with path.open("wb") as out:
        writer = Writer(out, chunk_size=chunk, compression=form)
        writer.start(profile="ros2", library="test")
        channels = {}
        for channel in file.channels:
            schema = writer.register_schema(channel.type, channel.encoding, channel.definition.encode())
            channels[channel.id] = writer.register_channel(channel.topic, channel.serialization, schema)
        for number, at, data, *_ in file.in_file_order():
            writer.add_message(channels[number], at, data, at)
        writer.finish()  # type: ignore[no-untyped-call]
    file.close()
    return path


def truncate(data: bytes, chance: random.Random, other: bytes) -> bytes:
    """The beginning."""
    del other
    return data[: chance.randrange(len(data) + 1)]


def flip(data: bytes, chance: random.Random, other: bytes) -> bytes:
    """Some bytes replaced."""
    del other
    found = bytearray(data)
    for _ in range(chance.choice((1, 1, 2, 8, 64))):
        found[chance.randrange(len(found))] = chance.choice((0, 255, 127, 128, chance.randrange(256)))
    return bytes(found)


def enlarge(data: bytes, chance: random.Random, other: bytes) -> bytes:
    """A length, or whatever stands there, replaced by a huge number."""
    del other
    at, size = chance.randrange(len(data)), chance.choice((2, 4, 8))
    return data[:at] + chance.choice((b"\xff" * size, b"\x7f" * size, b"\x00" * size)) + data[at + size :]


def splice(data: bytes, chance: random.Random, other: bytes) -> bytes:
    """A part of another file in the place of one of this."""
    start, length = chance.randrange(len(data)), chance.randrange(1, 512)
    begin = chance.randrange(len(other))
    return data[:start] + other[begin : begin + length] + data[start + chance.choice((0, length)) :]


DAMAGES: tuple[Callable[[bytes, random.Random, bytes], bytes], ...] = (truncate, flip, enlarge, splice)


def damage(source: Path, folder: Path, chance: random.Random, other: bytes) -> Path:
    """A damaged copy of a recording; of a folder, of one of its files."""
    target = folder / source.name
    if source.is_dir():
        target.mkdir(parents=True, exist_ok=True)
        files = {path.name: path.read_bytes() for path in source.iterdir()}
        name = chance.choice(sorted(files))
        files[name] = chance.choice(DAMAGES)(files[name], chance, other)
        for name, data in files.items():
            (target / name).write_bytes(data)
        return target
    folder.mkdir(parents=True, exist_ok=True)
    target.write_bytes(chance.choice(DAMAGES)(source.read_bytes(), chance, other))
    return target


def judge(spec: Spec, path: Path) -> Conclusion | str:
    """What is said of a recording: the conclusion, or why it can't be used."""
    try:
        replay = Replay(spec, open_recording(path, spec), strict=True)
        for _ in replay:
            pass
    except TraceError as error:
        return str(error)
    return conclude(replay)


def main(count: int, seed: int) -> None:
    """Judge damaged recordings, and print what came of it; whatever is raised ends it."""
    resource.setrlimit(resource.RLIMIT_AS, (3 * 2**30, 3 * 2**30))
    results: Counter[str] = Counter()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "pump.yaml").write_text(SPEC)
        spec = load_spec(folder / "pump.yaml").spec
        sources = whole_files(folder)
        files = [path.read_bytes() for path in sources if path.is_file()]
        slowest = 0.0
        for number in range(count):
            chance = random.Random(seed * 1_000_003 + number)
            path = damage(chance.choice(sources), folder / "damaged", chance, chance.choice(files))
            began = time.monotonic()
            try:
                said = judge(spec, path)
            except BaseException:
                sys.stderr.write(f"seed {seed}, number {number}: {path}\n")
                raise
            slowest = max(slowest, time.monotonic() - began)
            if isinstance(said, str):
                assert "\n" not in said, said
                results["refused"] += 1
            else:
                results[f"ended with {said.status}"] += 1
    sys.stdout.write(f"{dict(results)}; the slowest took {slowest:.2f} s\n")


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 0)
