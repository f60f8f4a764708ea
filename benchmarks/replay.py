"""What `replay` of a bag costs beside a bare loop that decodes, evaluates and steps the same; and how memory grows.

python benchmarks/replay.py [events]
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import median

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from oracle_server.core.plan import plan
from oracle_server.core.stamps import stamp_in
from oracle_server.engines.table import make_engines
from oracle_server.replay.bags.messages import message_reader
from oracle_server.specfiles.load import parse_spec

BASE = 1_732_147_200 * 10**9
SPEC = """
id: bench
ordering: {max_delay: 100ms}
streams:
  - topic: /imu
    signals: {fast: msg.angular_velocity.z > 1.0, still: msg.linear_acceleration.x < 0.1}
  - topic: /odom
    signals: {speed: msg.twist.twist.linear.x}
properties:
  - {id: calm, formula: '{topic: "/imu", fast} -> once[:50]{topic: "/odom", speed < 2}'}
  - {id: told, formula: '{topic: "/odom", speed > 1} -> once[:10]{topic: "/imu"}'}
  - {id: slow, formula: 'not {topic: "/odom", speed > 100}'}
"""


def write(path: Path, count: int) -> None:
    store = get_typestore(Stores.ROS2_HUMBLE)
    t = store.types
    vector, zeros = t["geometry_msgs/msg/Vector3"], np.zeros(9)
    rest = t["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0)
    still = vector(x=0.0, y=0.0, z=0.0)
    point = t["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0)
    pose = t["geometry_msgs/msg/PoseWithCovariance"](
        pose=t["geometry_msgs/msg/Pose"](position=point, orientation=rest), covariance=np.zeros(36)
    )
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        imu = writer.add_connection("/imu", "sensor_msgs/msg/Imu", typestore=store)
        odom = writer.add_connection("/odom", "nav_msgs/msg/Odometry", typestore=store)
        for i in range(count):
            at = BASE + i * 10**6
            stamp = t["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
            header = t["std_msgs/msg/Header"](stamp=stamp, frame_id="base")
            if i % 3 == 2:
                twist = t["geometry_msgs/msg/Twist"](linear=vector(x=i % 7 / 5, y=0.0, z=0.0), angular=still)
                with_covariance = t["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=np.zeros(36))
                message = t["nav_msgs/msg/Odometry"](
                    header=header, child_frame_id="map", pose=pose, twist=with_covariance
                )
            else:
                message = t["sensor_msgs/msg/Imu"](
                    header=header, orientation=rest, orientation_covariance=zeros,
                    angular_velocity=vector(x=0.0, y=0.0, z=i % 11 / 9), angular_velocity_covariance=zeros,
                    linear_acceleration=still, linear_acceleration_covariance=zeros,
                )  # fmt: skip
            connection = odom if i % 3 == 2 else imu
            writer.write(connection, at + 10**5, store.serialize_cdr(message, connection.msgtype))


def bare(path: Path) -> int:
    """Decode, evaluate, and step each property's engine: no order, no records, no verdicts."""
    ready = plan(parse_spec(SPEC, "bench").spec)
    (engines,) = make_engines(ready)
    by_name = {key.name: stream for key, stream in ready.streams.items()}
    count = 0
    with AnyReader([path]) as bag:
        readers = {
            c.id: message_reader(
                bag.typestore, c.msgtype, (by_name[c.topic].project.fields or set()) | {"header.stamp"}
            )
            for c in bag.connections
        }
        for connection, _, raw in bag.messages():
            data = readers[connection.id](bag.deserialize(raw, connection.msgtype))
            stream = by_name[connection.topic]
            signals, _ = stream.project(data)
            stamp = stamp_in(data, None) or 0
            for engine, view in zip(engines, stream.views, strict=True):
                matches: list[tuple[str, ...] | None] = [None] * view.size
                for test in view.tests:
                    matches[test.index] = test.match(signals)
                engine.step(stamp, matches)
            count += 1
    return count


def measured(folder: Path, bag: Path, what: str) -> tuple[float, int]:
    """Seconds of a run in a process of its own, less its start, and its peak memory in KiB."""
    code = (
        "import resource, sys, time; from pathlib import Path; sys.path.insert(0, 'benchmarks'); import replay as b\n"
        "import oracle_server.replay.command as r, oracle_server.replay.bags.bag\n"
        f"bag, spec = Path({str(bag)!r}), Path({str(folder / 'spec.yaml')!r})\n"
        "start = time.perf_counter()\n"
        + ("b.bare(bag)\n" if what == "bare" else "r.run_replay([spec], bag, None, 'text')\n")
        + "print('\\n', time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    seconds, memory = ended.stdout.splitlines()[-1].split()
    return float(seconds), int(memory)


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300_000
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "spec.yaml").write_text(SPEC)
        write(folder / "short", count // 10)
        write(folder / "long", count)
        rounds = []
        for _ in range(3):
            loop, _ = measured(folder, folder / "long", "bare")
            ours, peak = measured(folder, folder / "long", "replay")
            rounds.append((loop, ours, peak))
        loops, runs, peaks = zip(*rounds, strict=True)
        loop, ours, peak = median(loops), median(runs), max(peaks)
        _, small = measured(folder, folder / "short", "replay")
    print(json.dumps({
        "events": count, "bare_per_second": round(count / loop), "replay_per_second": round(count / ours),
        "ratio": round(loop / ours, 2), "peak_mib": round(peak / 1024), "peak_mib_of_a_tenth": round(small / 1024),
    }))  # fmt: skip


if __name__ == "__main__":
    main()
