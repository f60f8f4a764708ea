"""A mode manager's morning: two operators, and the planner in between. Prints a trace.

    python examples/modes/simulator.py [--fault]

With the fault the manager goes from TELEOP to AUTO at once, an operator takes the base twice, and it is driven in
FAULT.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Iterator
from typing import Any

START = 1_732_147_200 * 10**9
Message = tuple[str, dict[str, Any]]


def mode(name: str) -> Message:
    """The manager tells its mode."""
    return "/mode", {"data": name}


def lease(operator: str, action: str) -> Message:
    """An operator takes the base, or gives it back."""
    return "/lease", {"operator": operator, "action": action}


def drive(speed: float) -> Message:
    """The base is told how fast to go."""
    return "/cmd_vel", {"linear": {"x": speed}}


def morning(*, fault: bool) -> Iterator[Message]:
    """What is said, in order."""
    yield from (mode("IDLE"), mode("IDLE"), lease("ann", "take"), mode("TELEOP"), drive(0.3), drive(0.4))
    if fault:
        yield from (mode("AUTO"), mode("AUTO"), drive(0.5), lease("ann", "take"), mode("FAULT"), drive(0.1))
    else:
        yield from (drive(0.0), mode("IDLE"), lease("ann", "give"), mode("AUTO"), drive(0.5), mode("FAULT"))
    yield from (drive(0.0), mode("IDLE"), lease("bob", "take"), mode("TELEOP"), drive(0.2), drive(0.0))
    yield from (mode("IDLE"), lease("bob", "give"), mode("AUTO"), drive(0.6), mode("IDLE"))


def trace(*, fault: bool) -> Iterator[str]:
    """The lines of a trace: 100 ms apart, each some milliseconds on its way."""
    dice = random.Random(5)
    lines: list[dict[str, Any]] = []
    for number, (stream, data) in enumerate(morning(fault=fault)):
        stamp = START + number * 10**8
        arrived = stamp + dice.randrange(2, 180) * 10**6
        ask = {"ask": True} if stream == "/cmd_vel" else {}
        lines.append({"stream": stream, "stamp": stamp, "arrived": arrived, "data": data, **ask})
    for line in sorted(lines, key=lambda entry: entry["arrived"]):
        yield json.dumps(line)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fault", action="store_true")
    print(*trace(fault=parser.parse_args().fault), sep="\n")
