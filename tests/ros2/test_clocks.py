"""What clocks an adapter on real ROS 2 sends behind an ask."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from tests.adapters.common.conftest import Oracle
from tests.adapters.standin import check_clocks, switches
from tests.ros2.harness import Scene

srv = pytest.importorskip("std_srvs.srv")

# rclpy imports an old lark with its first node.
pytestmark = pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")


def test_behind_an_ask_every_stream_that_is_stamped_here_is_spoken_for(tmp_path: Path) -> None:
    oracle = Oracle()
    oracle.start()
    try:
        with Scene(tmp_path) as scene:
            adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros2", "--oracle", oracle.url, "--spec", "s")
            link = oracle.accept()
            link.attach(streams=switches())
            adapter.said("observing 8 streams")
            peer = scene.peer()
            client = peer.node.create_client(srv.SetBool, "/second_mon")
            peer.until(client.service_is_ready)
            client.call_async(srv.SetBool.Request(data=True))
            check_clocks(link)
    finally:
        oracle.end()
