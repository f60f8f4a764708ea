"""A recording goes on until its last message, whatever that is of: what is missing by then is violated."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.writer import CompressionType
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from oracle_server.replay.files.mcapfile import McapFile
from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import load_spec
from tests.replay.fuzzing import rewrite
from tests.replay.judging import BASE, MS, Judgement, judge, write_numbers, write_spec

SPEC = """
id: end
ordering: {order}
streams: [{{topic: /ask, type: std_msgs/msg/Float64}}, {{topic: /reply, type: std_msgs/msg/Float64}}]
properties:
  - {{id: answered, time: seconds, formula: '{{topic: "/ask"}} -> eventually[0:2] {{topic: "/reply"}}'}}
"""
ARRIVAL, PUBLICATION = "{by: arrival}", "{max_delay: 500ms}"
ASKED = {"/ask": [(0, 1.0), (5_000, 1.0)], "/reply": [(1_000, 1.0)]}
ON = [(at, 1.0) for at in range(6_000, 66_000, 1_000)]
FORMATS = ["mcap", "db3", "bag", "jsonl", "txt"]


def spec(folder: Path, order: str = ARRIVAL) -> Path:
    return write_spec(folder, SPEC.format(order=order))


def write(folder: Path, form: str, topics: dict[str, list[tuple[int, float]]]) -> Path:
    """A recording in a format."""
    if form in ("mcap", "db3"):
        storage = StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3
        return write_numbers(folder / "bag", topics, storage)
    path = folder / f"log.{form}"
    events = sorted((at, topic, value) for topic, found in topics.items() for at, value in found)
    if form == "bag":
        _ros1(path, events)
    else:
        of = {"jsonl": _line, "txt": _flat}[form]
        path.write_text("".join(json.dumps(of(at, topic, value)) + "\n" for at, topic, value in events))
    return path


def _ros1(path: Path, events: Iterable[tuple[int, str, float]]) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    make, ids = store.types["std_msgs/msg/Float64"], {}
    with Writer1(path) as writer:
        for at, topic, value in events:
            if topic not in ids:
                ids[topic] = writer.add_connection(topic, "std_msgs/msg/Float64", typestore=store)
            raw = store.serialize_ros1(make(data=value), "std_msgs/msg/Float64")
            writer.write(ids[topic], BASE + at * MS, raw)


def _line(at: int, topic: str, value: float) -> dict[str, Any]:
    return {"stream": topic, "stamp": BASE + at * MS, "arrived": BASE + at * MS, "data": {"data": value}}


def _flat(at: int, topic: str, value: float) -> dict[str, Any]:
    return {"topic": topic, "time": (BASE + at * MS) / 10**9, "data": value}


def missed(found: Judgement) -> list[float]:
    """When deadlines were violated, in seconds."""
    return [round((row["stamp"] - BASE) / 10**9, 6) for row in found.rows if row["violation"] and row["kind"] == "tick"]


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("order", [ARRIVAL, PUBLICATION])
def test_what_did_not_come_while_the_recording_went_on_is_violated(order: str, form: str, tmp_path: Path) -> None:
    path = write(tmp_path, form, ASKED | {"/tf": ON})
    found = judge(spec(tmp_path, order), path)
    assert found.exit == 1
    assert missed(found) == [7.0]
    (row,) = (row for row in found.rows if row["violation"])
    assert 0 <= row["judged"] - row["stamp"] < 2 * 500 * MS + 10  # as live: once it is sure, and not at the end


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(("order", "waits"), [(ARRIVAL, 0), (PUBLICATION, 500)])
def test_what_may_still_come_is_open(order: str, waits: int, form: str, tmp_path: Path) -> None:
    """A deadline is judged once nothing can come any more that is in time for it."""
    path = write(tmp_path, form, ASKED | {"/tf": [(6_999 + waits, 1.0)]})
    found = judge(spec(tmp_path, order), path)
    assert (found.exit, missed(found)) == (0, [])
    assert found.summary["properties"]["answered"]["pending"] == 1


REVISED = "{max_delay: 500ms, late: revise, horizon: 1s}"


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("order", [ARRIVAL, REVISED])
def test_a_stream_that_falls_silent_is_missed(order: str, form: str, tmp_path: Path) -> None:
    text = f"""
id: dead
ordering: {order}
streams: [{{topic: /scan}}]
properties: [{{id: scans_come, time: seconds, formula: 'once[0:1] {{topic: "/scan"}}'}}]
"""
    path = write(tmp_path, form, {"/scan": [(at, 1.0) for at in range(0, 5_000, 500)], "/tf": ON})
    found = judge(write_spec(tmp_path, text), path)
    assert found.exit == 1
    assert missed(found) == [5.5]


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_files_without_the_specs_topics_count(storage: StoragePlugin, tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", ASKED, storage)
    rest = write_numbers(tmp_path / "rest", {"/tf": ON}, storage)
    (file,) = (path for path in rest.iterdir() if path.suffix != ".yaml")
    file.rename(bag / file.name)
    described = yaml.safe_load((bag / "metadata.yaml").read_text())
    described["rosbag2_bagfile_information"]["relative_file_paths"].append(file.name)
    (bag / "metadata.yaml").write_text(yaml.safe_dump(described))
    found = judge(spec(tmp_path), bag)
    assert (found.exit, missed(found)) == (1, [7.0])


@pytest.mark.parametrize("form", [CompressionType.NONE, CompressionType.ZSTD])
def test_a_file_that_was_cut_goes_on_as_far_as_it_can_be_read(form: CompressionType, tmp_path: Path) -> None:
    """The heading of a chunk promises messages until later, among which the answer may be."""
    bag = write_numbers(tmp_path / "bag", ASKED | {"/tf": ON}, StoragePlugin.MCAP)
    path = rewrite(next(bag.glob("*.mcap")), tmp_path / "cut.mcap", form, chunk=400)
    whole, outcomes = path.read_bytes(), set()
    for size in range(len(whole) // 8, len(whole), len(whole) // 40):
        path.write_bytes(whole[:size])
        file = McapFile(path)
        last = max((at for _, at, *_ in file.in_file_order()), default=0)
        file.close()
        if last < BASE + 5_000 * MS:
            continue  # nothing was asked yet
        found = judge(spec(tmp_path), path)
        assert missed(found) == ([7.0] if last > BASE + 7_000 * MS else []), size
        outcomes.add(found.exit)
    assert outcomes == {0, 1}


def test_a_database_that_was_cut_goes_on_as_far_as_it_can_be_read(tmp_path: Path) -> None:
    bag = write_numbers(tmp_path / "bag", ASKED | {"/tf": ON * 40}, StoragePlugin.SQLITE3)
    (path,) = bag.glob("*.db3")
    path.write_bytes(path.read_bytes()[:-1000])
    found = judge(spec(tmp_path), path)
    assert "ends early" in found.said
    assert missed(found) == [7.0]


TRACE = [
    {"stream": "/ask", "monitor": "m", "seq": 1, "stamp": BASE, "arrived": BASE, "begun": BASE, "signals": {}},
    {"stream": "/old", "monitor": "m", "seq": 1, "stamp": BASE + 9_000 * MS, "arrived": BASE + 9_000 * MS,
     "signals": {}},
]  # fmt: skip


def own(folder: Path, *lines: dict[str, Any]) -> Path:
    """A session's own trace: its lines have their places, as they were judged by arrival."""
    path = folder / "own.jsonl"
    placed = [
        line | {"failed": [], "places": [{"position": n, "order": "arrival", "judged": line["arrived"]}]}
        for n, line in enumerate(lines, 1)
    ]
    path.write_text("".join(json.dumps(line) + "\n" for line in placed))
    return path


def test_a_sessions_own_trace_ends_as_the_session_did(tmp_path: Path) -> None:
    """What was not judged live is not judged now, but with another order; what its deadlines tell counts there."""
    asked, other = TRACE
    found = judge(spec(tmp_path), own(tmp_path, asked, other))
    assert (found.exit, missed(found)) == (0, [])
    at = BASE + 2_000 * MS + 1
    tick = {"stream": "", "kind": "tick", "monitor": "", "seq": 1, "stamp": at, "signals": {}}
    loaded = load_spec(spec(tmp_path)).spec
    for arrived in (at + 1, at + 10**18):  # the latter of a session in simulated time, whose own was the server's
        path = own(tmp_path, asked, tick | {"arrived": arrived})
        assert missed(judge(spec(tmp_path), path)) == [2.0]
        replay = Replay(loaded, open_recording(path, loaded), "arrival")
        times = [judged.step.stamp for judged in replay]
        assert times == [BASE, at]
        assert replay.session is not None
        assert replay.session.now == at + 1
        assert replay.violated == {"answered"}


def test_no_time_passes_where_none_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    lines = [{"stream": "/ask", "stamp": BASE, "data": {}}, {"stream": "/tf", "arrived": BASE + 10**12, "data": {}}]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec(tmp_path), path)
    assert (found.exit, missed(found)) == (0, [])
