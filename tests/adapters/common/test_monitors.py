"""Who is a monitor."""

from __future__ import annotations

import pytest
from oracle_adapter import graph_name
from oracle_adapter.monitors import ERRORS, doubtful


@pytest.mark.parametrize(
    ("monitor", "node"),
    [
        ("uav1", "/uav1"),
        ("uav--1", "/uav__1"),
        ("uav__1", "/robot/uav__1"),
        ("a/-b", "/a__b"),
        ("a/7", "/a_7"),
        ("7", "/monitor_7"),
    ],
)
def test_a_monitor_is_known_by_its_name(monitor: str, node: str) -> None:
    errors = f"{graph_name(monitor)}/{ERRORS}"
    assert doubtful({errors: [node, "/player"]}) == {"/player": errors}
