"""A file that is one of several of a bag, and is judged alone."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from pathlib import Path

import pytest
import yaml
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.test_folders import BOTH, SPEC, TOPICS


@pytest.mark.parametrize("described", [True, False])
@pytest.mark.parametrize("storage", BOTH)
def test_one_of_several_files_of_a_bag_is_said_to_be_no_more(
    storage: StoragePlugin, described: bool, tmp_path: Path
) -> None:
    """What the others have was not heard: of what was `once` there is nothing to be known."""
    bag, spec = write_numbers(tmp_path / "bag", TOPICS, storage), write_spec(tmp_path, SPEC)
    (part,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    first, second = (part.with_name(f"bag_{at}{part.suffix}") for at in (0, 1))
    part.rename(first)
    shutil.copy(first, second)
    document = yaml.safe_load((bag / "metadata.yaml").read_text())
    document["rosbag2_bagfile_information"]["relative_file_paths"] = [first.name, second.name]
    (bag / "metadata.yaml").write_text(yaml.safe_dump(document))
    if not described:
        (bag / "metadata.yaml").unlink()
    found = judge(spec, second)
    said = f"{second.name}: is one of the 2 files of a bag, and the others were not judged: name its folder, {bag}"
    assert (found.exit, found.strict, found.said) == (0, 3, said)


@pytest.mark.parametrize(("names", "messages", "said"), [(["a_0", "a_1"], 500, True), (["a_0"], 500, False),
    (["a_0", "a_1"], 1, False)])  # fmt: skip
@pytest.mark.parametrize("storage", BOTH)
def test_a_file_without_the_others_beside_it_tells_of_them(
    storage: StoragePlugin, names: list[str], messages: int, *, said: bool, tmp_path: Path
) -> None:
    """As one that was sent alone: rosbag2 writes into each file how many its bag has by then. Merged ones have all."""
    bag, spec = write_numbers(tmp_path / "bag", TOPICS, storage), write_spec(tmp_path, SPEC)
    (part,) = (path for path in bag.iterdir() if path.name != "metadata.yaml")
    alone = Path(shutil.move(part, tmp_path / f"a_1{part.suffix}"))
    text = yaml.safe_dump({"relative_file_paths": names, "message_count": messages})
    if storage is StoragePlugin.MCAP:
        content, at = alone.read_bytes(), len(b"\x89MCAP0\r\n")
        at += 9 + struct.unpack_from("<Q", content, at + 1)[0]  # behind the header
        about = _text("serialized_metadata") + _text(text)
        record = _text("rosbag2") + struct.pack("<I", len(about)) + about
        alone.write_bytes(content[:at] + struct.pack("<BQ", 12, len(record)) + record + content[at:])
    else:
        with sqlite3.connect(alone) as database:
            database.execute(
                "CREATE TABLE IF NOT EXISTS metadata (id INTEGER, metadata_version INTEGER, metadata TEXT)"
            )
            database.execute("DELETE FROM metadata")
            database.execute("INSERT INTO metadata VALUES (1, 9, ?)", (text,))
    found = judge(spec, alone)
    what = f"{alone.name}: is one of the 2 files of a bag, and the others were not judged: judge all together"
    assert (what in found.said, found.strict) == (said, 3 if said else 0)


def _text(text: str) -> bytes:
    return struct.pack("<I", len(text)) + text.encode()
