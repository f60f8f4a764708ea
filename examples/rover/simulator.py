"""A rover's round through a store of six drums, the fourth of which leaks. Prints a trace.

    python examples/rover/simulator.py [--fault]

With the fault its planner has an old radiation map: it sends the rover on into the leak, and a drum is reported unseen.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Iterator
from typing import Any

START = 1_732_147_200 * 10**9
LEAK = 4
Message = tuple[str, dict[str, Any]]


def round_trip(*, fault: bool) -> Iterator[Message]:
    """What the nodes say, in order: commands, arrivals, readings and reports."""
    for drum in range(1, 7):
        yield "/command", {"action": "approach", "drum": drum}
        leaking = drum == LEAK
        for level in (40.0, 280.0, 430.0) if leaking else (35.0, 60.0, 80.0):
            yield "/radiation", {"level": level}
        if leaking and not fault:
            yield "/command", {"action": "retreat", "drum": 0}
            yield "/radiation", {"level": 90.0}
            continue
        if not leaking:
            yield "/arrived", {"drum": drum}
        yield "/report", {"drum": drum, "sound": True}


def trace(*, fault: bool) -> Iterator[str]:
    """The lines of a trace: 100 ms apart, each some milliseconds on its way."""
    dice = random.Random(7)
    lines: list[dict[str, Any]] = []
    for number, (stream, data) in enumerate(round_trip(fault=fault)):
        stamp = START + number * 10**8
        delay = dice.randrange(2, 180) * 10**6
        lines.append({"stream": stream, "stamp": stamp, "arrived": stamp + delay, "data": data})
    for line in sorted(lines, key=lambda entry: entry["arrived"]):
        yield json.dumps(line)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fault", action="store_true")
    print(*trace(fault=parser.parse_args().fault), sep="\n")
