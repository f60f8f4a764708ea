"""A turtle that is driven in a window of 11 by 11, by the equations of its pose. Prints a trace.

    python examples/turtle/simulator.py [--fault]

With the fault its driver speeds, does not slow down at the edge, and has it teleported into the corner.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from typing import Any

START = 1_732_147_200 * 10**9
PERIOD = 0.1
Line = dict[str, Any]


def drive(*, fault: bool) -> Iterator[Line]:
    """Poses and velocities in turn, 100 ms apart, and a teleport at the end."""
    x, y, heading = 5.5, 5.5, 0.0
    for step in range(80):
        yield {"stream": "/turtle1/pose", "data": {"x": round(x, 3), "y": round(y, 3), "theta": round(heading, 3)}}
        edge = not (1.0 <= x <= 10.0 and 1.0 <= y <= 10.0)
        forward = 2.5 if fault and step == 20 else 1.9
        if edge and not fault:
            forward = 0.5
        turning = 2.5 if edge else 0.0
        twist = {"linear": {"x": forward, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turning}}
        yield {"stream": "/turtle1/cmd_vel", "data": twist, "ask": True}
        heading += turning * PERIOD
        x = min(max(x + forward * math.cos(heading) * PERIOD, 0.0), 11.0)
        y = min(max(y + forward * math.sin(heading) * PERIOD, 0.0), 11.0)
    target = {"x": 10.9, "y": 10.9, "theta": 0.0} if fault else {"x": 5.5, "y": 5.5, "theta": 0.0}
    call = {"stream": "/turtle1/teleport_absolute", "call": 1}
    yield call | {"kind": "request", "data": target, "ask": True}
    if not fault:  # a denied call does not reach the turtle
        yield call | {"kind": "response", "data": {}}


def trace(*, fault: bool) -> Iterator[str]:
    """The lines of a trace, 50 ms apart."""
    for number, line in enumerate(drive(fault=fault)):
        at = START + number * 5 * 10**7
        yield json.dumps(line | {"stamp": at, "arrived": at})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fault", action="store_true")
    print(*trace(fault=parser.parse_args().fault), sep="\n")
