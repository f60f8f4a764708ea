"""What the nodes of the mobile base do on either ROS: a mission of goals, a drive, an arm, and what goes wrong.

Both ROS packages have a link to this file.
"""

from typing import List, NamedTuple, Optional

FAULTS = (
    "none",
    "arm_out",  # the mission sends the base away while the arm reaches out
    "outside_map",  # the mission names a place that is not on the map
    "battery_low",  # the battery is low before the last goal, which is sent all the same
    "false_success",  # the base gives up before its first goal, and reports that it is there
)
NONE, BLOCKED = 0, 9001  # error codes of the result
SPEED = 2.0  # m/s
PERIOD = 0.05  # seconds between two steps of the drive
NEAR = 0.25  # metres from the goal at which the base is there
WALL = 6.0  # x (m) that the base can't pass
CHARGED, LOW = 0.8, 0.1  # of a full battery
REACHING = 0.2  # seconds that the arm takes from one pose to the other
STEADY = 20  # times that something is said, at 20 Hz, until everybody has heard it


class Leg(NamedTuple):
    """One goal of the mission, and what the mission expects of it."""

    name: str
    x: float
    y: float
    cancel_below: float = 0.0
    """The distance (m) below which the mission changes its mind; 0 for never."""
    arm_out: bool = False
    """Whether the arm reaches out as the goal is sent."""
    low: bool = False
    """Whether the battery is low as it is sent."""


LEGS = (
    Leg("to the shelf", 2.0, 1.0),
    Leg("to the window, and changing its mind", 4.0, 4.0, cancel_below=1.5),
    Leg("through the wall", 8.0, 4.0),
    Leg("home", 1.0, 1.0),
)


def known_fault(name: str) -> str:
    """The fault of this name, which may be another node's; ends the program where there is none."""
    if name not in FAULTS:
        raise SystemExit(f"unknown fault '{name}'; there are {', '.join(FAULTS)}")
    return name


def legs(fault: str) -> List[Leg]:
    """The goals of a mission, one after the other."""
    shelf, *others, home = LEGS
    bad = {
        "arm_out": [Leg("away with the arm out", 3.0, 1.0, arm_out=True)],
        "outside_map": [Leg("off the map", 40.0, 2.0)],
    }
    return [shelf, *bad.get(fault, []), *others, home._replace(low=fault == "battery_low")]


class Heard:
    """What is said on a topic, again and again."""

    def __init__(self) -> None:
        self._value: Optional[bool] = None
        self._times = 0

    def hear(self, value: bool) -> None:
        """Take the next message."""
        self._times = self._times + 1 if value == self._value else 1
        self._value = value

    def is_said(self, value: bool) -> bool:
        """Whether this was said last."""
        return self._value == value

    def is_known(self, value: bool) -> bool:
        """Whether this was said so often that others have heard it, too, as the monitor."""
        return self._value == value and self._times >= STEADY


class Drive:
    """Where the base is, and how it gets elsewhere."""

    def __init__(self, fault: str) -> None:
        self.x = self.y = 1.0
        self._false = fault == "false_success"

    def distance(self, x: float, y: float) -> float:
        """How far it is to a place (m)."""
        return float(((x - self.x) ** 2 + (y - self.y) ** 2) ** 0.5)

    def step(self, x: float, y: float) -> Optional[int]:
        """Drive on for `PERIOD`; the error code once the goal is over, which `NONE` says has been reached."""
        left = self.distance(x, y)
        if left < NEAR:
            return NONE
        if self._false and left < 0.7:
            self._false = False
            return NONE
        part = min(1.0, SPEED * PERIOD / left)
        if self.x + (x - self.x) * part > WALL:
            return BLOCKED
        self.x, self.y = self.x + (x - self.x) * part, self.y + (y - self.y) * part
        return None
