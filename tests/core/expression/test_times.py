"""Times that are read whole, by the names that ROS 1 and ROS 2 have for their parts."""

from __future__ import annotations

from typing import Any

import pytest

from oracle_server.core.expression import parse_expression, reason

WHOLE = {"sec": 7, "nanosec": 5}
MESSAGE: dict[str, Any] = {
    "stamp": WHOLE,
    "goals": [{"stamp": WHOLE}, {"stamp": {"sec": 9, "nanosec": 0}}],
    "asked": {"stamp": {"secs": 3}},
    "own": {"sec": 1, "nanosec": 2, "other": 3},
}


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("msg.goals[0].stamp.secs", 7),
        ("msg.goals[0].stamp.nsecs", 5),
        ("msg.goals.exists(g, g.stamp.secs > 8)", True),
        ("msg.goals.map(g, g.stamp.secs)[1]", 9),
        ("has(msg.goals[0].stamp.nsecs)", True),
        ("msg.stamp.secs + msg.stamp.sec", 14),
        ("has(msg.stamp.secs)", True),
        ("msg.asked.stamp.secs + 0", 3),
        ("has(msg.asked.stamp.sec)", False),
        ("has(msg.own.secs)", False),
    ],
)
def test_both_names_stand_for_a_part_of_a_time(text: str, value: object) -> None:
    expression = parse_expression(text)
    assert expression.code.run(MESSAGE, expression.frame(1000)) == value


@pytest.mark.parametrize("text", ["msg.own.secs + 0", "msg.asked.stamp.nsecs + 0", "msg.goals[0].stamp.seconds"])
def test_what_is_no_part_of_a_time_is_absent(text: str) -> None:
    assert reason(parse_expression(text), MESSAGE, 1000) == "is absent"
