"""Chance with a seed that can be repeated (TEST_SEED), and what all runs are compared with."""

from __future__ import annotations

import os
import random
import time
from typing import Any

import pytest

from examples.battery_uav.simulator import MS, arrivals, simulate
from tests.chaos.link import Frame
from tests.chaos.runs import COUNTDOWNS


@pytest.fixture
def chance() -> random.Random:
    seed = int(os.environ.get("TEST_SEED") or random.randrange(2**32))
    print(f"TEST_SEED={seed}")
    return random.Random(seed)


@pytest.fixture(scope="session")
def trace() -> list[Frame]:
    """What is observed, in the order of publication, stamped so that all of it has just happened."""
    lines: list[dict[str, Any]] = arrivals(
        simulate(fault="request_without_change", countdowns=COUNTDOWNS), MS, 0, in_order=True
    )
    shift = time.time_ns() - lines[-1]["stamp"]
    chance = random.Random(0)
    return [
        {
            "type": "event",
            **{key: line[key] for key in ("stream", "kind", "source", "call", "data") if key in line},
            "stamp": line["stamp"] + shift,
            "ask": line["kind"] == "request" or chance.random() < 0.05,
        }
        for line in lines
    ]


@pytest.fixture(scope="session")
def known() -> dict[str, list[Frame]]:
    """The records of uninterrupted runs, by layout."""
    return {}
