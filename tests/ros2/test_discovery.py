"""The adapter where profiles of Fast DDS say how nodes find each other, as by a discovery server on a TurtleBot 4."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.processes import held_port
from tests.robot import spec_folder
from tests.ros2.harness import Scene

msg = pytest.importorskip("std_msgs.msg")

# rclpy imports an old lark with its first node, and warns by functions of its own that are deprecated.
pytestmark = pytest.mark.filterwarnings(
    "ignore:module 'sre_:DeprecationWarning", "ignore:Deprecated in favor of:DeprecationWarning"
)
SPEC = """
id: speed
streams:
  - {topic: /speed, type: std_msgs/msg/Int64, action: filter, intercept: publisher, signals: {speed: msg.data}}
properties:
  - {id: slow, formula: '{speed < 10}', guards: [/speed]}
"""
PROFILE = """
<profiles xmlns="http://www.eprosima.com"><participant profile_name="server" is_default_profile="true"><rtps>
  <prefix>44.53.00.5f.45.50.52.4f.53.49.4d.41</prefix>
  <builtin>
    <discovery_config><discoveryProtocol>SERVER</discoveryProtocol></discovery_config>
    <metatrafficUnicastLocatorList>
      <locator><udpv4><address>127.0.0.1</address><port>%d</port></udpv4></locator>
    </metatrafficUnicastLocatorList>
  </builtin>
</rtps></participant></profiles>
"""
SERVER = """
import os, sys
os.environ["FASTDDS_DEFAULT_PROFILES_FILE"] = sys.argv[1]
del os.environ["ROS_DISCOVERY_SERVER"]
import rclpy
rclpy.init()
rclpy.spin(rclpy.create_node("discovery"))
"""
PEERS = """
import rclpy
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Int64
rclpy.init()
base, rogue = rclpy.create_node("base"), rclpy.create_node("rogue")
base.create_subscription(Int64, "/speed", lambda heard: print("heard", heard.data, flush=True), 10)
publisher = rogue.create_publisher(Int64, "/speed", 10)
rogue.create_timer(0.1, lambda: publisher.publish(Int64(data=100)))
executor = SingleThreadedExecutor()
executor.add_node(base)
executor.add_node(rogue)
executor.spin()
"""
"""In a process of their own: one that has known a discovery server never forgets it."""
NUMBERED = """
<profiles xmlns="http://www.eprosima.com"><participant profile_name="pilot" is_default_profile="true"><rtps>
  <prefix>44.53.00.5f.45.50.52.4f.53.49.4d.42</prefix>
</rtps></participant></profiles>
"""
PILOT = """
import sys, time
import rclpy
from rclpy.duration import Duration
from std_msgs.msg import Int64
rclpy.init()
node = rclpy.create_node("pilot")
publisher = node.create_publisher(Int64, "/speed_mon", 10)
while not publisher.get_subscription_count():
    time.sleep(0.01)
for number in map(int, sys.argv[1:]):
    publisher.publish(Int64(data=number))
publisher.wait_for_all_acked(Duration(seconds=60))
print("said", flush=True)
rclpy.shutdown()
"""


@pytest.mark.parametrize("super_client", ["", "False"])
def test_who_publishes_past_the_monitor_is_told_by_a_discovery_server(
    super_client: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene, ExitStack() as stack:
        port = held_port(stack)  # of TCP; that of UDP of this number is as free as any
        profile = tmp_path / "server.xml"
        profile.write_text(PROFILE % port)
        monkeypatch.setenv("ROS_DISCOVERY_SERVER", f"127.0.0.1:{port}")
        monkeypatch.setenv("ROS_SUPER_CLIENT", super_client)
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SYSTEM_DEFAULT")
        scene.run("discovery", sys.executable, "-c", SERVER, profile)
        adapter = scene.adapter("speed")
        scene.run("peers", sys.executable, "-c", PEERS).said("heard 100")
        adapter.said("/speed: /rogue publishes /speed past the monitor")
        adapter.ends_well()


def test_a_node_that_is_started_again_under_the_numbers_of_before_is_heard(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A profile says by which numbers DDS knows it; its messages count from 1 again."""
    profile = tmp_path / "pilot.xml"
    profile.write_text(NUMBERED)
    with Scene(tmp_path, spec_folder(tmp_path, SPEC)) as scene:
        adapter = scene.adapter("speed")
        peer = scene.peer()
        heard = peer.record(msg.Int64, "/speed")
        peer.until(lambda: peer.node.count_publishers("/speed"))
        monkeypatch.setenv("FASTDDS_DEFAULT_PROFILES_FILE", str(profile))
        for speeds in ([1, 2, 3, 4], [5, 6]):
            before = len(heard)
            pilot = scene.run("pilot", sys.executable, "-c", PILOT, *speeds)
            peer.until(lambda before=before, speeds=speeds: len(heard) == before + len(speeds))
            pilot.said("said")
            assert pilot.wait() == 0
        assert [said.data for said in heard] == [1, 2, 3, 4, 5, 6]
        adapter.ends_well()
