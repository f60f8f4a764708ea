"""An event loop that stands still is noticed."""

from __future__ import annotations

import asyncio
import time

import pytest

from oracle_server.process.watchdog import Watchdog
from tests.processes import PATIENCE


async def test_a_loop_that_stands_still_is_reported_with_its_place(capsys: pytest.CaptureFixture[str]) -> None:
    with Watchdog(stalled=0.2) as watchdog:
        begin = time.monotonic()
        while not watchdog.stalls and time.monotonic() < begin + PATIENCE:
            pass  # the loop has no turn
    assert watchdog.stalls == 1
    said = capsys.readouterr().out
    assert "stands still" in said
    assert "test_watchdog.py" in said


async def test_a_loop_that_goes_round_is_not_reported() -> None:
    with Watchdog(stalled=3600) as watchdog:
        for _ in range(100):
            await asyncio.sleep(0)
    assert watchdog.stalls == 0
