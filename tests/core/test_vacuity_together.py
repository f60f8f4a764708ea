"""Warnings of what lacks its signals together: neither part matters alone, as the other one is not there either."""

from __future__ import annotations

import pytest

from tests.core.test_vacuity_told import warnings


@pytest.mark.parametrize(
    "formula",
    [
        '{topic: "/cmd_vel", cmd > 0} -> {stopped: false} and {percent > 20}',
        '{topic: "/cmd_vel", cmd > 0} -> {stopped: false} and {percent > 20} and once {id: a}',
        '{topic: "/cmd_vel", cmd > 0} -> not ({stopped: false} and {percent > 20})',
        '{topic: "/cmd_vel"} and {stopped: false} and {percent > 20} -> {cmd: 0}',
        "{cmd > 0} -> {stopped: false} and {percent > 20}",
    ],
)
def test_signals_of_two_other_streams_that_are_asked_together_are_each_told(formula: str) -> None:
    assert [w.message.split(": ", 1)[1] for w in warnings(formula)] == [
        "`{stopped: false}` never holds at an event of /cmd_vel: only /estop has `stopped`; name it under `hold` of "
        "/estop, so that it keeps its value",
        "`{percent > 20}` never holds at an event of /cmd_vel: only /battery has `percent`; name it under `hold` of "
        "/battery, so that it keeps its value",
    ]


def test_alternatives_of_two_streams_are_not_warned_of() -> None:
    both = '({topic: "/estop"} and {stopped} and {level > 1}) or ({topic: "/battery"} and {percent > 20})'
    assert warnings(f"{{level > 1}} -> {both} or {{cmd > 0}}") == ()
