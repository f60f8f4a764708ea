"""Numbers of calls, by which a response is found for its request."""

from __future__ import annotations

import itertools
import secrets
from typing import Iterator

_FIRST = 2**52
"""The first number is no larger: the wire takes numbers below twice as much."""


def call_numbers() -> Iterator[int]:
    """Successive numbers from a random one on.

    A session may last longer than an adapter, and have several: no other call of it may have the
    same number. The clock could not tell them apart, as it is wrong after some starts of a robot.
    """
    return itertools.count(secrets.randbelow(_FIRST) + 1)
