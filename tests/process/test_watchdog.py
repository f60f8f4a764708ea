"""An event loop that stands still is noticed."""

from __future__ import annotations

import asyncio
import re
import time
from collections import deque
from itertools import repeat

import pytest

from oracle_server.process.watchdog import Watchdog
from tests.processes import PATIENCE


def check_told(said: str) -> None:
    """One line tells for how long the loop stood still, and where."""
    (line,) = [line for line in said.splitlines() if "still" in line]
    assert "test_watchdog.py" in line
    seconds = re.search(r"seconds=(\S+)", line)
    assert seconds
    assert float(seconds[1]) > 0


async def test_a_loop_that_stands_still_is_reported_with_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    with Watchdog(stalled=0.2) as watchdog:
        begin = time.monotonic()
        while not watchdog.stalls and time.monotonic() < begin + PATIENCE:
            pass  # the loop has no turn
    assert watchdog.stalls == 1
    check_told(capsys.readouterr().out)


def hold_the_interpreter(steps: int) -> None:
    """One call into a library: until it returns no other thread of this process runs."""
    deque(repeat(None, steps), maxlen=0)


async def test_a_call_that_holds_the_interpreter_is_reported_with_its_place(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with Watchdog(stalled=0.1) as watchdog:
        begin, steps = time.monotonic(), 2**22
        while not watchdog.stalls and time.monotonic() < begin + PATIENCE:
            steps *= 2
            hold_the_interpreter(steps)
            for _ in range(2):  # what is overdue in the loop has its turn
                await asyncio.sleep(0)
    assert watchdog.stalls == 1
    check_told(capsys.readouterr().out)


async def test_a_loop_that_goes_round_is_not_reported() -> None:
    with Watchdog(stalled=3600) as watchdog:
        for _ in range(100):
            await asyncio.sleep(0)
    assert watchdog.stalls == 0
