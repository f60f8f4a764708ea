"""The rows of many recordings say what `replay` says of each alone."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import StoragePlugin

from oracle_server.replay.command import run_replay
from oracle_server.replay.many.row import Row
from tests.processes import ROOT
from tests.replay.many.recordings import judged, question, write_recordings, write_specs
from tests.replay.writing import SPEC, write_ros1, write_ros2

UAV = ROOT / "specs" / "battery_uav.yaml"
EXAMPLES = [
    *((UAV, path) for path in sorted((ROOT / "examples/battery_uav/traces").glob("*.jsonl"))),
    *(
        (ROOT / "examples" / name / f"{name}.yaml", path)
        for name in ("manipulator", "navigation", "rover", "turtle")
        for path in sorted((ROOT / "examples" / name / "traces").glob("*.jsonl"))
    ),
    *(
        (ROOT / "examples/requirements" / f"{folder.name}.yaml", path)
        for folder in sorted((ROOT / "examples/requirements/traces").iterdir())
        for path in sorted(folder.glob("*.jsonl"))
    ),
]
ROBUST = """
id: robust
streams:
  - {topic: /speed, signals: {speed: msg.data}, hold: [speed]}
properties:
  - {id: below_three, engine: rtamt, formula: speed < 3}
"""
SAME = ("outcome", "violations", "unknown", "first_violation_step", "first_violation_at")


def same(capsys: pytest.CaptureFixture[str], specs: list[Path], recording: Path, **options: Any) -> list[Row]:
    """The rows of a recording, once it is sure that they have what `replay` says of it by each spec."""
    rows = judged(question(specs, **options), recording)
    by, strict = options.get("by"), options.get("strict", False)
    for spec in specs:
        status = run_replay([spec], recording, by, "jsonl", strict=strict)
        *records, last = map(json.loads, capsys.readouterr().out.splitlines())
        summary, own = last["summary"], [row for row in rows if row.spec_path == str(spec)]
        assert len(own) == len(summary["properties"])
        for row in own:
            second = f"{row.property} (arrival)"
            name = second if row.order == "arrival" and second in summary["properties"] else row.property
            state = summary["properties"][name]
            assert {key: getattr(row, key) for key in SAME} == {key: state[key] for key in SAME}
            assert (row.events, row.exit, row.pending) == (summary["events"], status, state.get("pending"))
            assert row.unjudged == {each["property"]: each["reason"] for each in summary["unjudged"]}.get(row.property)
            texts = [record["explanation"]["text"] for record in records if _violates(record, row)]
            assert row.explanation == (texts[0] if texts else None)
        assert max((row.late or 0) for row in own) <= summary["late"]
    return rows


def _violates(record: dict[str, Any], row: Row) -> bool:
    return record.get("violation", False) and (record["property"], record["order"]) == (row.property, row.order)


@pytest.mark.parametrize(("spec", "recording"), EXAMPLES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_an_example_is_judged_as_alone(capsys: pytest.CaptureFixture[str], spec: Path, recording: Path) -> None:
    rows = same(capsys, [spec], recording)
    for row in rows:
        assert (row.episodes or 0) <= (row.violations or 0)
        assert bool(row.episodes) == bool(row.violations)


def test_it_is_by_several_specs(capsys: pytest.CaptureFixture[str]) -> None:
    specs = [ROOT / "examples/requirements" / name for name in ("r04_estop.yaml", "r01_speed_limit.yaml")]
    rows = same(capsys, [*specs, UAV], ROOT / "examples/requirements/traces/r04_estop/slow.jsonl")
    assert {row.spec: row.exit for row in rows} == {"r04_estop": 1, "r01_speed_limit": 2, "battery_uav": 2}


@pytest.mark.parametrize("by", ["publication", "arrival", "both"])
def test_it_is_in_each_order(capsys: pytest.CaptureFixture[str], by: str) -> None:
    rows = same(capsys, [UAV], ROOT / "examples/battery_uav/traces/shuffled.jsonl", by=by)
    assert {row.order for row in rows} == ({"publication", "arrival"} if by == "both" else {by})


def test_it_is_with_revisions_and_derived_signals(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    specs = write_specs(tmp_path)
    late = 0
    for path in write_recordings(tmp_path / "recordings", 7):
        rows = same(capsys, specs, path)
        late += sum(row.late or 0 for row in rows if row.spec == "rising")
    assert late


@pytest.mark.parametrize("strict", [False, True])
def test_a_bag_is_judged_as_alone(capsys: pytest.CaptureFixture[str], tmp_path: Path, strict: bool) -> None:
    spec = tmp_path / "pump.yaml"
    spec.write_text(SPEC)
    write_ros1(tmp_path / "pump.bag", 30)
    write_ros2(tmp_path / "pump", StoragePlugin.MCAP, 30)
    for bag in (tmp_path / "pump.bag", tmp_path / "pump"):
        (low, read) = same(capsys, [spec], bag, strict=strict)
        assert (low.violations, read.violations) == (3, 0)


def test_robustness_is_the_least_that_was_measured(tmp_path: Path) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(ROBUST)
    recording = write_recordings(tmp_path / "recordings", 1)[0]
    (row,) = judged(question([spec]), recording)
    assert (row.robustness, row.outcome) == (-1.5, "currently_false")
