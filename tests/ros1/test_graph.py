"""What the adapter asks the master."""

from __future__ import annotations

import socket

import pytest
from oracle_ros1 import graph


def test_a_master_that_does_not_answer_is_not_waited_for_without_end(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:  # takes connections, and reads nothing
        monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{silent.getsockname()[1]}")
        monkeypatch.setattr(graph, "REPLY_WITHIN", 0.05)
        with pytest.raises(OSError, match="timed out"):
            graph.master_proxy().getSystemState()
