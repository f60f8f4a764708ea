"""When messages are held back on their way to the monitor, as a middleware or a wireless link holds them at times.

All is drawn from a seed, so that each way of judging is measured under the same stalls. Times are in seconds.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass

LINKS = {
    "battery": ("battery_percentage",),
    "supervisor": ("input_accepted", "battery_status"),
    "led_panel": ("LED_panel", "status_accepted"),
}
"""The topics that come from each node: one link, on which messages do not overtake each other."""
ALL = "all"
HELD = ("battery",) * 3 + ("supervisor",) * 3 + ("led_panel",) * 2 + (ALL,) * 2
"""What the ten stalls of a run hold: each holds one link, or all of them."""
SHORTEST, LONGEST = 0.2, 0.6
FIRST, LAST = 0.1, 3.6
"""When stalls begin at the earliest and at the latest, since the first percentage; a countdown takes 4 s."""


@dataclass(frozen=True, order=True)
class Stall:
    """A time in which nothing passes on a link, or on none; what was held passes at its end."""

    start: float
    end: float
    held: str

    def is_on(self, link: str) -> bool:
        return self.held in (link, ALL)

    def meets(self, other: Stall) -> bool:
        """Whether both hold a link at one time."""
        shared = self.held == other.held or ALL in (self.held, other.held)
        return shared and self.start <= other.end and other.start <= self.end


def schedule(seed: int) -> list[Stall]:
    """The stalls of a run, by their starts, none for seed 0; no two of them hold one link at a time."""
    if not seed:
        return []
    chance = random.Random(seed)
    while True:
        found: list[Stall] = []
        for held in HELD:
            start = chance.uniform(FIRST, LAST)
            stall = Stall(start, start + chance.uniform(SHORTEST, LONGEST), held)
            if any(stall.meets(other) for other in found):
                break
            found.append(stall)
        if len(found) == len(HELD):
            return sorted(found)


def passing(due: float, link: str, stalls: Iterable[Stall]) -> tuple[float, Stall | None]:
    """When a message passes that would have passed when it was due, and the stall that has held it."""
    for stall in stalls:
        if stall.is_on(link) and stall.start <= due < stall.end:
            return stall.end, stall
    return due, None
