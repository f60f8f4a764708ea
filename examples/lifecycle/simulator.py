"""A camera and a controller that are brought up, used and put away as managed nodes of ROS 2. Prints a trace.

    python examples/lifecycle/simulator.py [--fault]

With the fault the controller hangs as it is activated and commands all the same, and the camera is cleaned up while
it is active.
"""

from __future__ import annotations

import argparse
import json
import random
from collections.abc import Iterator
from typing import Any

START = 1_732_147_200 * 10**9
TENTH = 10**8
Message = tuple[int, str, dict[str, Any]]
"""When (in tenths of a second), and what."""


def transitions(node: str, start: int, *labels: str) -> Iterator[Message]:
    """What a node says of its transitions, each of which takes 300 ms; an empty one is not told of."""
    for i, label in enumerate(labels):
        if label:
            yield start + 3 * i, f"/{node}/transition_event", {"transition": {"label": label}}


def mission(*, fault: bool) -> Iterator[Message]:
    """What the nodes say."""
    success = "transition_success"
    yield from transitions("camera", 0, "configure", success, "activate", success)
    yield from transitions("controller", 1, "configure", success, "activate", "" if fault else success)
    for i in range(20, 25):
        yield i, "/cmd_vel", {"linear": {"x": 0.2}}
    if fault:
        yield from transitions("camera", 65, "cleanup")
        return
    yield from transitions("controller", 26, "deactivate", success, "cleanup", success)
    yield from transitions("camera", 60, "deactivate", success, "shutdown", success)


def trace(*, fault: bool) -> Iterator[str]:
    """The lines of a trace, each some milliseconds on its way."""
    dice = random.Random(11)
    lines: list[dict[str, Any]] = []
    for at, stream, data in sorted(mission(fault=fault), key=lambda each: each[0]):
        stamp = START + at * TENTH
        arrived = stamp + dice.randrange(2, 180) * 10**6
        ask = {"ask": True} if stream == "/cmd_vel" else {}
        lines.append({"stream": stream, "stamp": stamp, "arrived": arrived, "data": data, **ask})
    for line in sorted(lines, key=lambda entry: entry["arrived"]):
        yield json.dumps(line)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fault", action="store_true")
    print(*trace(fault=parser.parse_args().fault), sep="\n")
