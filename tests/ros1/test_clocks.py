"""What clocks an adapter on real ROS 1 sends behind an ask."""

from __future__ import annotations

import sys
from pathlib import Path

from std_srvs.srv import SetBool, SetBoolRequest

from tests.adapters.common.conftest import Oracle
from tests.adapters.standin import check_clocks, switches
from tests.ros1.harness import Scene


def test_behind_an_ask_every_stream_that_is_stamped_here_is_spoken_for(tmp_path: Path) -> None:
    oracle = Oracle()
    oracle.start()
    try:
        with Scene(tmp_path) as scene:
            adapter = scene.run("adapter", sys.executable, "-m", "oracle_ros1", "--oracle", oracle.url, "--spec", "s")
            link = oracle.accept()
            link.attach(streams=switches())
            adapter.said("observing 8 streams")
            scene.peer().begin(SetBool, "/second_mon", SetBoolRequest(data=True))
            check_clocks(link)
    finally:
        oracle.end()
