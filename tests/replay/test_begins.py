"""A recording goes on from its first message, whatever that is of: what is missing from then on is violated."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.replay.opening import open_recording
from oracle_server.replay.run import Replay
from oracle_server.specfiles.load import load_spec
from tests.replay.judging import BASE, MS, judge, write_numbers, write_spec
from tests.replay.test_ends import ARRIVAL, FORMATS, PUBLICATION, REVISED, missed, own, write

SPEC = """
id: begin
ordering: {order}
streams: [{{topic: /scan}}]
properties: [{{id: scans_come, time: seconds, formula: 'once[0:1] {{topic: "/scan"}}'}}]
"""
BEFORE = {"/tf": [(at, 1.0) for at in range(0, 3_000, 500)]}
SCANS = {"/scan": [(at, 1.0) for at in range(3_000, 5_000, 500)]}


def spec(folder: Path, order: str = ARRIVAL) -> Path:
    return write_spec(folder, SPEC.format(order=order))


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("order", [ARRIVAL, PUBLICATION, REVISED])
def test_what_did_not_come_from_the_beginning_on_is_violated(order: str, form: str, tmp_path: Path) -> None:
    found = judge(spec(tmp_path, order), write(tmp_path, form, BEFORE | SCANS))
    assert (found.exit, missed(found)) == (1, [1.0])
    (row,) = (row for row in found.rows if row["violation"])
    assert 0 <= row["judged"] - row["stamp"] < 2 * 500 * MS + 10  # as live: once it is sure


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize("first", [2_000, 2_999])
def test_what_comes_in_time_is_not_missed(first: int, form: str, tmp_path: Path) -> None:
    found = judge(spec(tmp_path), write(tmp_path, form, {"/tf": [(first, 1.0)]} | SCANS))
    assert (found.exit, missed(found)) == (0, [])


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
def test_a_file_without_the_specs_topics_counts(storage: StoragePlugin, tmp_path: Path) -> None:
    """As the first one of a bag that was split."""
    bag = write_numbers(tmp_path / "bag", BEFORE, storage)
    rest = write_numbers(tmp_path / "rest", SCANS, storage)
    (bag / "metadata.yaml").unlink()
    (file,) = (path for path in rest.iterdir() if path.suffix != ".yaml")
    file.rename(bag / f"later_{file.name}")
    found = judge(spec(tmp_path), bag)
    assert (found.exit, missed(found)) == (1, [1.0])


@pytest.mark.parametrize("form", ["bag", "db3"])
def test_a_file_that_was_cut_begins_with_its_first_message(form: str, tmp_path: Path) -> None:
    more = [(at, 1.0) for at in range(5_000, 400_000, 500)]
    path = write(tmp_path, form, BEFORE | {"/scan": [*SCANS["/scan"], *more]})
    path = next(path.glob("*.db3")) if path.is_dir() else path
    path.write_bytes(path.read_bytes()[:-1000])
    found = judge(spec(tmp_path), path)
    assert "ends early" in found.said
    assert missed(found) == [1.0]


def test_what_was_lost_before_may_have_been_what_is_missing(tmp_path: Path) -> None:
    lines = [
        {"stream": "/tf", "stamp": BASE, "arrived": BASE, "data": {}},
        {"stream": "/scan", "stamp": BASE + 3_000 * MS, "arrived": BASE + 3_000 * MS, "data": {}, "lost": 2},
    ]
    path = tmp_path / "log.jsonl"
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec(tmp_path), path)
    assert missed(found) == [1.0]
    assert all(row["degraded"] for row in found.rows)


def test_a_sessions_own_trace_begins_as_the_session_did(tmp_path: Path) -> None:
    """With another order, too; a trace of another version does not tell when its session began."""
    scan = {"stream": "/scan", "monitor": "m", "seq": 1, "signals": {}}
    old = {"stream": "/old", "monitor": "m", "seq": 2, "signals": {}, "stamp": BASE, "arrived": BASE}
    later = scan | {"stamp": BASE + 3_000 * MS, "arrived": BASE + 3_000 * MS}
    loaded = load_spec(spec(tmp_path)).spec
    assert missed(judge(spec(tmp_path), own(tmp_path, later | {"begun": BASE}))) == [], "not judged live, nor now"
    for begun, missing in ((BASE - 1_000 * MS, [0]), (BASE + 2_500 * MS, []), (None, [1_000])):
        path = own(tmp_path, old | ({} if begun is None else {"begun": begun}), later)
        replay = Replay(loaded, open_recording(path, loaded), "arrival")
        times = [judged.step.stamp for judged in replay]
        assert times == [*(BASE + at * MS for at in missing), BASE + 3_000 * MS]


def test_no_time_passes_where_none_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    lines = [{"stream": "/tf", "stamp": BASE, "data": {}}, {"stream": "/scan", "stamp": BASE + 10**12, "data": {}}]
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    found = judge(spec(tmp_path), path)
    assert (found.exit, missed(found)) == (0, [])


ALIVE = """
id: alive
streams: [{topic: /scan}]
properties: [{id: scans_come, time: seconds, formula: 'historically once[:2s] {topic: "/scan"}'}]
"""


@pytest.mark.parametrize("storage", [StoragePlugin.MCAP, StoragePlugin.SQLITE3])
@pytest.mark.parametrize("begins", [0, 500_000 - BASE // MS], ids=["by the clock", "in a simulation"])
def test_a_time_of_zero_is_none(begins: int, storage: StoragePlugin, tmp_path: Path) -> None:
    """As a recorder in a simulation writes before it has heard of its time: nobody waited since then."""
    topics = {
        topic: [(-BASE // MS, 1.0), *((begins + at, 1.0) for at in range(0, 5_000, 500))] for topic in ("/scan", "/tf")
    }
    found = judge(write_spec(tmp_path, ALIVE), write_numbers(tmp_path / "bag", topics, storage))
    assert (found.exit, found.strict, found.said) == (0, 0, "")
    first = BASE + begins * MS
    assert [row["arrived"] for row in found.rows[:2]] == [first, first]
