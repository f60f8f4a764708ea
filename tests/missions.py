"""Missions of the mobile base on either ROS: what comes of its goals, by fault, and what the history has of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.processes import ROOT, Data, Server, eventually

SPECS = ROOT / "examples" / "navigation"
BROKEN = {
    "none": None,
    "arm_out": "arm_is_stowed",
    "outside_map": "inside_the_map",
    "battery_low": "enough_battery",
    "false_success": "success_is_near",
}
"""By fault, the property that does not hold, once."""
ENDS = [
    "to the shelf: succeeded",
    "to the window, and changing its mind: canceled",
    "through the wall: aborted",
    "home: succeeded",
]
FAULTY = {
    "arm_out": [*ENDS[:1], "away with the arm out: rejected", *ENDS[1:]],
    "outside_map": [*ENDS[:1], "off the map: rejected", *ENDS[1:]],
    "battery_low": [*ENDS[:3], "home: rejected"],
    "false_success": ["to the shelf: aborted", *ENDS[1:]],
}
every_fault = pytest.mark.parametrize("fault", BROKEN)


def mission(made: Any, folder: Path, fault: str) -> None:
    """Fly a mission on a scene that `made` makes, and check what its node says, and the history."""
    with made(folder, SPECS) as scene:
        adapter = scene.adapter("navigation")
        arm = scene.node("arm", package="navigation", wait_for=2)
        base = scene.node("base", package="navigation", wait_for=2, fault=fault)
        sent = scene.node("mission", package="navigation", fault=fault)
        assert sent.wait() == 0, sent.log
        said = [line.partition("]: ")[2] or line for line in sent.log.splitlines()]
        for end in FAULTY.get(fault, ENDS):
            assert any(end in line for line in said), sent.log
        for node in (base, arm, adapter):
            node.ends_well()
        judged(scene.server, fault)


def judged(server: Server, fault: str) -> None:
    """The history has one violation, of the property that goes with the fault; what it is about did not pass."""
    events = eventually(lambda: server.events("s", stream="/navigate_to_pose"), bool)
    asked = [event for event in events if event["decision"] is not None]
    denied = [event for event in asked if event["decision"] == "deny"]
    broken = [record["property"] for record in server.records("s", "violations")]
    assert broken == ([BROKEN[fault]] if BROKEN[fault] else [])
    assert [event["kind"] for event in denied] == ["result" if fault == "false_success" else "goal"] * len(broken)
    assert [event["passed"] for event in asked] == [event not in denied for event in asked]
    for kind in ("reply", "result"):
        assert len(of(kind, events)) == len(of("goal", events)) - len(of("goal", denied))
    assert len(of("cancel", events)) == 1


def of(kind: str, events: list[Data]) -> list[Data]:
    return [event for event in events if event["kind"] == kind]
