"""What an expression may cost, counted in steps of some 100 ns at most: a replay counts what the robot did.

What is known beforehand, some steps a node, counts at `check`, and nothing when it runs; what depends on the message is
charged as it happens, against what is left in the first place of the frame.
"""

from __future__ import annotations

from typing import Any

from oracle_server.core.expression.stops import Exhausted

MAX_STEPS = 100_000
"""Most steps an event, shared equally by the signals whose cost depends on the message."""
MAX_KNOWN_STEPS = 20_000
"""Most steps that the signals of one stream may take at every message, whatever is in it."""
MAX_ROWS = 256
"""Most elements of a list of which each is a step of its own."""
MAX_NESTING = 40
"""Deepest nesting of an expression, and of values that are compared."""
MAX_NAMES = 64
"""Most names of a path."""

PART = 1
ARITHMETIC = 3
CALL = 4
CONVERSION = 4
PATTERN = 20
SHOWN_REAL = 30
"""`string()` of a real number."""
ELEMENT = 3
"""An element that `min` or `max` looks at."""
CAUGHT = 10
"""A part of `&&`, `||`, `exists` or `all` that has no value, where another may decide."""

Frame = list[Any]
"""The steps that are left, then the values of the variables of comprehensions, by depth."""


def charge(frame: Frame, steps: int) -> None:
    """Take some steps off what is left. Raises `Exhausted`."""
    frame[0] -= steps
    if frame[0] < 0:
        raise Exhausted("costs too much")
