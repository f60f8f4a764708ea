"""Bags of every format are judged alike, custom types included."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import sqlite3
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from oracle_server.replay.bags.definitions import types_of
from oracle_server.replay.files.storage import Channel
from tests.replay.judging import judge, write_numbers, write_spec
from tests.replay.writing import BASE, PUMP, SPEC, VALVE, write_ros1, write_ros2
from tests.whole.harness import COMMAND, environment, failed, run

ROUNDS = 30

FORMATS: dict[str, Callable[[Path], Path]] = {
    "ros1": lambda folder: write_ros1(folder / "pump.bag", ROUNDS),
    "sqlite3": lambda folder: write_ros2(folder / "pump", StoragePlugin.SQLITE3, ROUNDS),
    "mcap_folder": lambda folder: write_ros2(folder / "pump", StoragePlugin.MCAP, ROUNDS),
    "mcap": lambda folder: next(write_ros2(folder / "pump", StoragePlugin.MCAP, ROUNDS).glob("*.mcap")),
}


@pytest.fixture
def spec(tmp_path: Path) -> Path:
    path = tmp_path / "pump.yaml"
    path.write_text(SPEC)
    return path


def judged(spec: Path, bag: Path, *options: str | Path) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    ended = run("replay", spec, bag, "--json", *options)
    assert ended.returncode == 1, ended.stderr
    *records, last = map(json.loads, ended.stdout.splitlines())
    return records, last["summary"]


@pytest.mark.parametrize("form", FORMATS)
def test_a_bag_is_judged_with_custom_types(form: str, spec: Path, tmp_path: Path) -> None:
    records, summary = judged(spec, FORMATS[form](tmp_path))
    assert summary["events"] == ROUNDS + 1
    assert summary["properties"]["all_is_read"]["violations"] == 0
    assert summary["properties"]["pressure_is_low"]["violations"] == ROUNDS // 10
    assert summary["ignored"] == (0 if form == "ros1" else 1)
    first = next(r for r in records if r["stream"] == "/pump")
    assert first["arrived"] - first["stamp"] == 10**6, "stamped by the header, arrived when it was recorded"
    violation = next(r for r in records if r["violation"])
    signals = violation["explanation"]["event"]["signals"]
    wanted = {"pressure": 7.25, "mode": "auto", "open": True, "raw": "AQI=", "first": "inlet", "flow": -2.5}
    assert wanted.items() <= signals.items()


def test_a_bag_without_definitions_needs_the_types(spec: Path, tmp_path: Path) -> None:
    bag = write_ros2(tmp_path / "old", StoragePlugin.SQLITE3, ROUNDS, version=8)
    (database,) = bag.glob("*.db3")
    with contextlib.closing(sqlite3.connect(database)) as old, old:  # as ROS 2 wrote them up to Humble
        old.execute("DROP TABLE message_definitions")
        old.execute("UPDATE schema SET schema_version = 3")
    ended = run("replay", spec, bag)
    assert (ended.returncode, "plant_msgs/msg/Pump is unknown; give the folder" in ended.stderr) == (2, True)
    assert "pressure_is_low was not judged: /pump: the type" in ended.stdout
    folder = tmp_path / "src" / "plant_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "Pump.msg").write_text(PUMP)
    (folder / "Valve.msg").write_text(VALVE)
    _, summary = judged(spec, bag, "--types", tmp_path / "src")
    assert summary["properties"]["pressure_is_low"]["violations"] == ROUNDS // 10
    assert "has no .msg, .srv or .action files" in failed("replay", spec, bag, "--types", tmp_path / "old")
    (folder / "Valve.msg").write_text("float64 [[")
    assert "Valve.msg" in failed("replay", spec, bag, "--types", tmp_path / "src")


@pytest.mark.parametrize("column", ["topic_id INTEGER", "timestamp INTEGER", "data BLOB"])
def test_a_bag_whose_messages_are_computed_is_refused(column: str, spec: Path, tmp_path: Path) -> None:
    """What computes them may take for ever, and nothing ends it."""
    bag = write_ros2(tmp_path / "odd", StoragePlugin.SQLITE3, ROUNDS, version=9)
    (database,) = bag.glob("*.db3")
    name = column.split(maxsplit=1)[0]
    with contextlib.closing(sqlite3.connect(database)) as odd, odd:
        odd.execute("ALTER TABLE messages RENAME TO stored")
        others = [each for each in ("topic_id", "timestamp", "data") if each != name]
        kept = ", ".join(("id", *others))
        odd.execute(f"CREATE TABLE messages ({kept}, {column} GENERATED ALWAYS AS (1))")
        odd.execute(f"INSERT INTO messages ({kept}) SELECT {kept} FROM stored")
    assert "it has no table of topics, or none of messages" in failed("replay", spec, database)


def test_what_is_no_bag_is_refused_in_one_line(spec: Path, tmp_path: Path) -> None:
    for name in ("broken.bag", "broken.mcap"):
        (tmp_path / name).write_bytes(b"\x89MCAP0\r\n or is it")
        assert name in failed("replay", spec, tmp_path / name)
    (tmp_path / "empty").mkdir()
    assert "can't be read as a bag" in failed("replay", spec, tmp_path / "empty")
    assert "missing.bag" in failed("replay", spec, tmp_path / "missing.bag")


def test_a_bar_is_shown_to_a_person_only(spec: Path, tmp_path: Path) -> None:
    bag = FORMATS["mcap"](tmp_path)
    assert "pump" not in run("replay", spec, bag, "--json").stderr.replace("'/other', which pump", "")
    ours, theirs = pty.openpty()
    subprocess.run(
        [COMMAND, "replay", spec, bag], stdout=subprocess.DEVNULL, stderr=theirs, env=environment(), check=False
    )
    os.close(theirs)
    shown = b""
    while chunk := _read(ours):
        shown += chunk
    os.close(ours)
    assert b"pump_0.mcap" in shown or b"pump.mcap" in shown


def _read(terminal: int) -> bytes:
    try:
        return os.read(terminal, 4096)
    except OSError:
        return b""  # the other end is closed


def test_the_types_of_a_topic_with_many_publishers_are_made_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ROS 1 gives each publisher a connection of its own, and a node that starts anew is another one."""
    made = []

    def counted(channel: Channel, *others: Any) -> Typestore:
        made.append(channel.topic)
        return types_of(channel, *others)

    monkeypatch.setattr("oracle_server.replay.bags.sources.types_of", counted)
    store = get_typestore(Stores.ROS1_NOETIC)
    number = store.serialize_ros1(store.types["std_msgs/msg/Float64"](data=1.0), "std_msgs/msg/Float64")
    with Writer1(tmp_path / "many.bag") as writer:
        for i in range(20):
            topic, caller = ("/x", "/y")[i % 2], f"/node{i}"
            connection = writer.add_connection(topic, "std_msgs/msg/Float64", typestore=store, callerid=caller)
            writer.write(connection, BASE + i, number)
    found = judge(write_spec(tmp_path, BOTH), tmp_path / "many.bag")
    assert (found.summary["events"], found.exit) == (20, 0)
    assert made == ["/x", "/y"] * 2  # for each of two replays


BOTH = """
id: numbers
streams: [{topic: /x, signals: {x: msg.data}}, {topic: /y, signals: {y: msg.data}}]
properties: [{id: low, formula: '{x: *} -> {x < 2}'}]
"""


@pytest.mark.parametrize("form", ["ros1", "sqlite3", "mcap"])
def test_a_topic_is_the_same_without_its_slash(form: str, tmp_path: Path) -> None:
    """A bag that was put together of several may have it by both names: each message is judged."""
    told = {"/x": [(0, 1.0), (2, 5.0)], "x": [(1, 1.0), (3, 1.0)], "y/": [(4, 1.0)]}
    if form == "ros1":
        path = tmp_path / "both.bag"
        store = get_typestore(Stores.ROS1_NOETIC)
        with Writer1(path) as writer:
            for topic, values in told.items():
                connection = writer.add_connection(topic, "std_msgs/msg/Float64", typestore=store)
                for at, value in values:
                    number = store.types["std_msgs/msg/Float64"](data=value)
                    writer.write(connection, BASE + at, store.serialize_ros1(number, "std_msgs/msg/Float64"))
    else:
        path = write_numbers(tmp_path / "both", told, StoragePlugin[form.upper()])
    found = judge(write_spec(tmp_path, BOTH), path)
    assert (found.summary["events"], found.summary["violations"], found.said) == (5, 1, "")
    assert found.summary["ignored"] == 0
