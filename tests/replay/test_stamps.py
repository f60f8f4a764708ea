"""Publication times in bags stand where the spec says, in its units and since its epoch."""

from __future__ import annotations

from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin

from tests.replay.judging import BASE, MS, judge, write_numbers, write_spec

SPEC = """
id: stamped
streams:
  - {{topic: /time, type: std_msgs/msg/Float64, stamp: {stamp}, signals: {{heard: 1 == 1}}}}
properties:
  - {{id: known, formula: '{{topic: "/time"}} -> {{heard: *}}'}}
"""
ARRIVED = (10, 20, 30)
SENT = (1_000, 1_005, 1_015)
"""Times of arrival since `BASE`, and of publication since the robot's start, in milliseconds."""


def stamps(folder: Path, stamp: str, told: list[float]) -> list[int]:
    """When the messages were published (ms since `BASE`), as the records have it."""
    bag = write_numbers(folder / "bag", {"/time": list(zip(ARRIVED, told, strict=True))}, StoragePlugin.MCAP)
    found = judge(write_spec(folder, SPEC.format(stamp=stamp)), bag)
    assert found.exit == 0
    return [round((row["stamp"] - BASE) / MS) for row in found.rows]


def test_times_since_the_start_begin_with_the_first_arrival(tmp_path: Path) -> None:
    told = [float(sent * 1_000) for sent in SENT]
    assert stamps(tmp_path, "{field: data, unit: us, epoch: boot}", told) == [10, 15, 25]


@pytest.mark.parametrize(("unit", "size"), [("ms", 1), ("us", 1_000)])
def test_times_have_the_unit_of_the_spec(unit: str, size: int, tmp_path: Path) -> None:
    told = [float((BASE // MS + at - 5) * size) for at in ARRIVED]
    assert stamps(tmp_path, f"{{field: data, unit: {unit}}}", told) == [5, 15, 25]
