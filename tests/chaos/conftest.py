"""Chance with a seed that can be repeated (TEST_SEED), and what all runs are compared with."""

from __future__ import annotations

import os
import random

import pytest

from tests.chaos.link import Frame
from tests.chaos.runs import observed
from tests.history.backends import postgres, relay

__all__ = ["postgres", "relay"]


@pytest.fixture
def chance() -> random.Random:
    seed = int(os.environ.get("TEST_SEED") or random.randrange(2**32))
    print(f"TEST_SEED={seed}")
    return random.Random(seed)


@pytest.fixture(scope="session")
def trace() -> list[Frame]:
    return observed()


@pytest.fixture(scope="session")
def known() -> dict[str, list[Frame]]:
    """The records of uninterrupted runs, by layout."""
    return {}
