"""Judges a recording within this process: what a person, or a program, is told of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.records import VerdictRecord
from oracle_server.replay.command import run_replay
from oracle_server.replay.conclusion import conclude
from oracle_server.replay.opening import open_recording
from oracle_server.replay.report.lines import records
from oracle_server.replay.run import Replay
from oracle_server.rostypes.known import Types
from oracle_server.rostypes.streams import stream_types
from oracle_server.specfiles.load import load_spec

BASE = 1_732_147_200 * 10**9
MS = 10**6


class Judgement(NamedTuple):
    """The records, the summary, and the exit status with and without `--strict`."""

    rows: list[VerdictRecord]
    summary: dict[str, Any]
    exit: int
    strict: int

    @property
    def said(self) -> str:
        """All that is to be known of the recording, a line each."""
        return "\n".join(self.summary["notes"])


def write_spec(folder: Path, text: str) -> Path:
    """A spec file."""
    path = folder / "spec.yaml"
    path.write_text(text)
    return path


def judge(spec: Path, bag: Path) -> Judgement:
    """Judge a recording."""
    loaded = load_spec(spec).spec
    types, _ = stream_types(loaded, Types((), {}), None)
    ends, rows = [], []
    for strict in (False, True):
        replay = Replay(loaded, open_recording(bag, loaded), types=types, strict=strict)
        rows = [row for judged in replay for row in records(replay, judged)]
        ends.append(replay.summary() | conclude(replay).as_data())
    return Judgement(rows, ends[0], ends[0]["exit"], ends[1]["exit"])


def exit_of(spec: Path, bag: Path, *, strict: bool = False) -> int:
    """The exit status of the command, whose report goes to standard output."""
    return run_replay([spec], bag, None, "text", strict=strict)


def write_numbers(path: Path, topics: dict[str, list[tuple[int, float]]], storage: StoragePlugin) -> Path:
    """A bag of `std_msgs/msg/Float64`: for each topic times in ms, and numbers."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    make = store.types["std_msgs/msg/Float64"]
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        ids = {topic: writer.add_connection(topic, "std_msgs/msg/Float64", typestore=store) for topic in topics}
        events = sorted((at, topic, value) for topic, found in topics.items() for at, value in found)
        for at, topic, value in events:
            writer.write(ids[topic], BASE + at * MS, store.serialize_cdr(make(data=value), "std_msgs/msg/Float64"))
    return path
