"""Writes bags of every format, with a custom type, for the tests: the same rounds of a pump each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

BASE = 1_732_147_200 * 10**9
PUMP = """std_msgs/Header header
float32 pressure
string mode
bool open
uint8[] raw
float64[2] flows
Valve[] valves
"""
VALVE = "string name\nfloat64 angle\n"
SPEC = """
id: pump
ordering: {max_delay: 1s}
streams:
  - topic: /pump
    type: plant_msgs/msg/Pump
    signals:
      pressure: msg.pressure
      mode: msg.mode
      open: msg.open
      raw: msg.raw
      first: msg.valves[0].name
      flow: msg.flows[1]
  - topic: /limit
    type: std_msgs/msg/Float64
    hold: [limit]
    signals: {limit: msg.data}
properties:
  - {id: pressure_is_low, formula: '{topic: "/pump"} -> {pressure <= 7.2}'}
  - {id: all_is_read, formula: '{topic: "/pump"} -> {raw: "AQI=", first: "inlet", flow: -2.5}'}
"""


def types(store: Stores) -> Typestore:
    """The types of a ROS, and the plant's own."""
    found = get_typestore(store)
    found.register(
        {**get_types_from_msg(PUMP, "plant_msgs/msg/Pump"), **get_types_from_msg(VALVE, "plant_msgs/msg/Valve")}
    )
    return found


def messages(store: Typestore, rounds: int, *, ros1: bool = False) -> Iterator[tuple[str, int, Any]]:
    """Topic, time of arrival and message; in every tenth round the pressure is 7.25."""
    import numpy as np

    header, time = store.types["std_msgs/msg/Header"], store.types["builtin_interfaces/msg/Time"]
    for i in range(rounds):
        at = BASE + i * 10**7
        if i % 100 == 0:
            yield "/limit", at, store.types["std_msgs/msg/Float64"](data=float(i))
        fields: dict[str, Any] = {"stamp": time(sec=at // 10**9, nanosec=at % 10**9), "frame_id": "plant"}
        valve = store.types["plant_msgs/msg/Valve"](name="inlet", angle=0.5)
        pump = store.types["plant_msgs/msg/Pump"](
            header=header(**({"seq": i} if ros1 else {}), **fields),
            pressure=7.25 if i % 10 == 9 else 7.1,
            mode="auto",
            open=True,
            raw=np.array([1, 2], dtype=np.uint8),
            flows=np.array([float("nan"), -2.5]),
            valves=[valve],
        )
        yield "/pump", at + 10**6, pump


def write_ros2(path: Path, storage: StoragePlugin, rounds: int, version: int = 9) -> Path:
    """A ROS 2 bag folder."""
    store = types(Stores.ROS2_HUMBLE)
    with Writer2(path, version=version, storage_plugin=storage) as writer:  # type: ignore[arg-type]
        connections = {
            "/pump": writer.add_connection("/pump", "plant_msgs/msg/Pump", typestore=store),
            "/limit": writer.add_connection("/limit", "std_msgs/msg/Float64", typestore=store),
            "/other": writer.add_connection("/other", "std_msgs/msg/Float64", typestore=store),
        }
        for topic, at, message in messages(store, rounds):
            connection = connections[topic]
            writer.write(connection, at, store.serialize_cdr(message, connection.msgtype))
        spare = store.types["std_msgs/msg/Float64"](data=1.0)
        writer.write(connections["/other"], BASE, store.serialize_cdr(spare, "std_msgs/msg/Float64"))
    return path


def write_ros1(path: Path, rounds: int) -> Path:
    """A ROS 1 bag."""
    store = types(Stores.ROS1_NOETIC)
    with Writer1(path) as writer:
        connections = {
            "/pump": writer.add_connection("/pump", "plant_msgs/msg/Pump", typestore=store),
            "/limit": writer.add_connection("/limit", "std_msgs/msg/Float64", typestore=store),
        }
        for topic, at, message in messages(store, rounds, ros1=True):
            connection = connections[topic]
            writer.write(connection, at, store.serialize_ros1(message, connection.msgtype))
    return path
