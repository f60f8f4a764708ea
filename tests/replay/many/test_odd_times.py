"""A recording with a time that is none among others: they are all in the table."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from mcap.writer import Writer

from oracle_server.replay.many.command import run_many
from oracle_server.replay.many.tablefile import read_rows
from tests.replay.judging import BASE

SPEC = """
id: low
ordering: {by: arrival}
streams: [{topic: /x, type: std_msgs/msg/Float64, signals: {v: msg.data}}]
properties: [{id: low, formula: '{topic: "/x"} -> {v < 5}'}]
"""


def write(path: Path, *times: int) -> Path:
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros2", library="test")
        schema = writer.register_schema("std_msgs/msg/Float64", "ros2msg", b"float64 data\n")
        channel = writer.register_channel("/x", "cdr", schema)
        for time in times:
            writer.add_message(channel, time, b"\x00\x01\x00\x00" + struct.pack("<d", 1.0), time)
        writer.finish()  # type: ignore[no-untyped-call]
    return path


@pytest.mark.parametrize("time", [2**64 - 1, 2**63, 2**64 - 10**9])
def test_it_is_damage_and_spoils_no_table(time: int, tmp_path: Path) -> None:
    spec, table = tmp_path / "spec.yaml", tmp_path / "table.parquet"
    spec.write_text(SPEC)
    odd = write(tmp_path / "odd.mcap", BASE, BASE + 1, time)
    whole = write(tmp_path / "whole.mcap", BASE, BASE + 1)
    assert run_many([odd, whole], [spec], out=table) == 0
    first, second = read_rows(table)
    assert (first.events, first.last_at, second.events) == (2, BASE + 1, 2)
    assert "which is no time" in (first.notes or "")
    assert run_many([odd, whole], [spec], out=table, strict=True) == 3
