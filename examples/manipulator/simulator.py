"""An arm at work while a person walks up to it and away again. Prints a trace.

    python examples/manipulator/simulator.py [--fault]

With the fault the arm brakes late, and its scanner is silent for half a second. Without, nobody is heard for half a
second while the person comes near, and the arm begins to brake when it hears of it.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Iterator
from typing import Any

START = 1_732_147_200 * 10**9
PERIOD = 0.05
SECONDS = 8.0
FULL, SLOW, STILL = 1.0, 0.2, 0.0


def distance(at: float) -> float:
    """How far the person is: from 3 m to 0.3 m and back, in eight seconds."""
    return round(0.3 + 2.7 * abs(at - SECONDS / 2) / (SECONDS / 2), 3)


def run(*, fault: bool) -> Iterator[tuple[float, str, dict[str, Any]]]:
    """Measurements and the arm's state at 20 Hz; the arm slows down by 4 m/s in a second."""
    speed, at = FULL, 0.0
    braking = 0.6 if fault else 4.0
    for step in range(round(SECONDS / PERIOD)):
        at = step * PERIOD
        if not fault and 1.9 < at < 2.4:
            continue
        if not (fault and 1.0 < at < 1.5):
            yield at, "/separation", {"distance": distance(at)}
        allowed = STILL if distance(at) < 0.5 else SLOW if distance(at) < 1.5 else FULL
        speed = max(allowed, speed - braking * PERIOD) if speed > allowed else min(allowed, speed + 0.5 * PERIOD)
        yield at + 0.02, "/arm/state", {"speed": round(speed, 3)}


def trace(*, fault: bool) -> Iterator[str]:
    """The lines of a trace, each up to 30 ms on its way."""
    dice = random.Random(11)
    lines: list[dict[str, Any]] = []
    for at, stream, data in run(fault=fault):
        stamp = START + round(at * 10**9)
        lines.append({"stream": stream, "stamp": stamp, "arrived": stamp + dice.randrange(30) * 10**6, "data": data})
    for line in sorted(lines, key=lambda entry: entry["arrived"]):
        yield json.dumps(line)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fault", action="store_true")
    print(*trace(fault=parser.parse_args().fault), sep="\n")
