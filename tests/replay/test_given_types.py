"""Types that the folders of `--types` define come before those of ROS 2's own packages, in every way."""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from oracle_server.replay.command import run_replay
from oracle_server.rostypes.bagtypes import typestore
from tests.replay.judging import BASE

SPEC = """
id: near
streams: [{topic: /range, type: sensor_msgs/msg/Range, signals: {r: msg.range}}]
properties: [{id: near, formula: '{topic: "/range"} -> {r < 5}'}]
"""
HUMBLE = """std_msgs/Header header
uint8 ULTRASOUND=0
uint8 INFRARED=1
uint8 radiation_type
float32 field_of_view
float32 min_range
float32 max_range
float32 range
"""
"""As it was before it had a variance."""


def folder(path: Path, text: str) -> Path:
    (path / "sensor_msgs" / "msg").mkdir(parents=True)
    (path / "sensor_msgs" / "msg" / "Range.msg").write_text(text)
    return path


def write(path: Path, ranges: Sequence[float]) -> Path:
    """A bag in sqlite3 as Humble writes it: it has no definitions."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    own, header, time = (store.types[name] for name in ("sensor_msgs/msg/Range", "std_msgs/msg/Header", TIME))
    with Writer2(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/range", "sensor_msgs/msg/Range", typestore=store)
        for n, value in enumerate(ranges):
            stamped = header(stamp=time(sec=BASE // 10**9 + n, nanosec=1), frame_id="f")
            message = own(
                header=stamped, radiation_type=0, field_of_view=0.1, min_range=0.1, max_range=9.0, range=value
            )
            writer.write(connection, BASE + n * 10**9, store.serialize_cdr(message, "sensor_msgs/msg/Range"))
    with sqlite3.connect(next(path.glob("*.db3"))) as database:
        database.execute("DROP TABLE IF EXISTS message_definitions")
    database.close()
    return path


TIME = "builtin_interfaces/msg/Time"


def test_a_bag_of_an_older_ros_is_judged_by_its_own_definitions(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(SPEC)
    types = folder(tmp_path / "src", HUMBLE)
    near, far = write(tmp_path / "near", [1.0, 2.0]), write(tmp_path / "far", [1.0, 6.0, 2.0])
    assert run_replay([spec], near, None, "text") == 2, "the newest definition has more"
    assert "none of its 2 messages could be read as sensor_msgs/msg/Range" in capsys.readouterr().err
    assert run_replay([spec], near, None, "text", [types]) == 0
    assert run_replay([spec], far, None, "text", [types]) == 1
    assert "r = 6" in capsys.readouterr().out


def test_the_first_folder_counts_and_what_none_has_is_as_in_the_newest_ros(tmp_path: Path) -> None:
    store = typestore([folder(tmp_path / "a", HUMBLE), folder(tmp_path / "b", "int8 other\n")])
    assert [name for name, _ in store.fielddefs["sensor_msgs/msg/Range"][1]][-1] == "range"
    newest = get_typestore(Stores.LATEST)
    assert store.fielddefs.keys() == newest.fielddefs.keys()
    assert store.fielddefs["sensor_msgs/msg/Imu"] == newest.fielddefs["sensor_msgs/msg/Imu"]
    assert [name for name, _ in typestore([]).fielddefs["sensor_msgs/msg/Range"][1]][-1] == "variance"


def test_a_bag_is_decoded_by_a_package_in_a_folder_of_another_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = tmp_path / "spec.yaml"
    spec.write_text(SPEC)
    source = folder(tmp_path / "src", HUMBLE) / "sensor_msgs"
    (source / "package.xml").write_text("<package><name>sensor_msgs</name></package>")
    source.rename(source.with_name("sensor_msgs-humble"))
    assert run_replay([spec], write(tmp_path / "near", [1.0, 2.0]), None, "text", [tmp_path / "src"]) == 0
    assert run_replay([spec], write(tmp_path / "far", [1.0, 9.0]), None, "text", [tmp_path / "src"]) == 1
