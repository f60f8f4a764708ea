"""What was kept since before a recording began, for who comes later, stands where it was recorded."""

from __future__ import annotations

from pathlib import Path

import pytest
from mcap.writer import Writer
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from oracle_server.replay.opening import open_recording
from oracle_server.specfiles.load import load_spec
from tests.replay.judging import BASE, MS, judge, write_spec

HEADER = "std_msgs/msg/Header"
SPEC = """
id: mapped
ordering: {max_delay: 500ms}
streams:
  - {topic: /map, signals: {map: msg.frame_id}}
  - {topic: /scan, signals: {scan: msg.frame_id}}
derive: {scan_age: {age: '{topic: "/scan"}'}}
properties:
  - {id: fresh, time: seconds, formula: 'not {scan_age > 0.5}'}
  - {id: often, pattern: '/scan at least 5 Hz over 1s'}
"""
HOUR = 3_600_000
STORAGES = ["mcap", "sqlite3", "ros1", "ros1 as mcap", "ros1 converted"]
"""The last but one is as MCAP's profile of ROS 1 has it, the last one as `mcap convert` takes it over from a bag."""
LATCHING = {"ros1 as mcap": "true", "ros1 converted": "1"}
Told = tuple[str, int, int]
"""A message: its topic, when it was recorded, and its stamp, both in ms from the beginning."""


def write(folder: Path, told: list[Told], storage: str, lasting: str = "/map") -> Path:
    path = folder / "bag"
    ros1 = storage.startswith("ros1")
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    make, time = store.types[HEADER], store.types["builtin_interfaces/msg/Time"]
    seq = {"seq": 0} if ros1 else {}

    def raw(stamp: int) -> bytes:
        seconds, rest = divmod(BASE + stamp * MS, 10**9)
        message = make(**seq, stamp=time(sec=seconds, nanosec=rest), frame_id="map")
        serialize = store.serialize_ros1 if ros1 else store.serialize_cdr
        return bytes(serialize(message, HEADER))

    if storage == "ros1":
        with Writer1(path) as writer:
            names = dict.fromkeys(topic for topic, *_ in told)
            ids = {t: writer.add_connection(t, HEADER, typestore=store, latching=int(t == lasting)) for t in names}
            for topic, at, stamp in told:
                writer.write(ids[topic], BASE + at * MS, raw(stamp))
        return path
    if ros1:
        write_mcap(path, [(topic, at, raw(stamp)) for topic, at, stamp in told], {lasting: LATCHING[storage]})
        return path
    with Writer2(path, version=9, storage_plugin=StoragePlugin[storage.upper()]) as writer2:
        ids2 = {
            t: writer2.add_connection(t, HEADER, typestore=store, offered_qos_profiles=[qos(lasting=t == lasting)])
            for t in dict.fromkeys(topic for topic, *_ in told)
        }
        for topic, at, stamp in told:
            writer2.write(ids2[topic], BASE + at * MS, raw(stamp))
    return path


def write_mcap(path: Path, told: list[tuple[str, int, bytes]], latching: dict[str, str]) -> None:
    """What ROS 1 says in MCAP, with what it says of topics that are latched."""
    with path.open("wb") as out:
        writer = Writer(out)
        writer.start(profile="ros1", library="test")
        schema = writer.register_schema("std_msgs/Header", "ros1msg", b"uint32 seq\ntime stamp\nstring frame_id\n")
        for topic in dict.fromkeys(topic for topic, *_ in told):
            about = {"callerid": "/node", "latching": latching.get(topic, "0")}
            channel = writer.register_channel(topic, "ros1", schema, about)
            for _, at, raw in (one for one in told if one[0] == topic):
                writer.add_message(channel, BASE + at * MS, raw, BASE + at * MS)
        writer.finish()  # type: ignore[no-untyped-call]


def qos(*, lasting: bool) -> Qos:
    durability = QosDurability.TRANSIENT_LOCAL if lasting else QosDurability.VOLATILE
    never = QosTime(sec=2147483647, nsec=4294967295)
    return Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, durability, never, never,
        QosLiveliness.AUTOMATIC, never, avoid_ros_namespace_conventions=False,
    )  # fmt: skip


def stamps(folder: Path, told: list[Told], storage: str, lasting: str = "/map") -> list[int | None]:
    """In ms from the beginning, as they count."""
    path, spec = write(folder, told, storage, lasting), load_spec(write_spec(folder, SPEC)).spec
    return [None if r.event.stamp is None else (r.event.stamp - BASE) // MS for r in open_recording(path, spec)]


@pytest.mark.parametrize("storage", STORAGES)
def test_nothing_is_missing_before_the_recording_began(storage: str, tmp_path: Path) -> None:
    scans = [("/scan", at + 1, at) for at in range(0, 5000, 100)]
    found = judge(write_spec(tmp_path, SPEC), write(tmp_path, [("/map", 0, -HOUR), *scans], storage))
    assert (found.exit, found.said) == (0, "")


@pytest.mark.parametrize("storage", STORAGES)
def test_other_stamps_count_as_ever(storage: str, tmp_path: Path) -> None:
    told = [("/map", 0, -1), ("/scan", 1, -HOUR), ("/map", 2, 0), ("/map", 3, 1)]
    assert stamps(tmp_path, told, storage) == [0, -HOUR, 0, 1]


def test_what_lasts_in_simulated_time_stands_in_that(tmp_path: Path) -> None:
    simulated = -BASE // MS + 5000
    assert stamps(tmp_path, [("/map", 0, simulated), ("/scan", 1, simulated + 1)], "mcap") == [simulated, simulated + 1]
