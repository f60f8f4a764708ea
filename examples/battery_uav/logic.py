"""What the nodes of the battery UAV do on either ROS: counting down, supervising, showing lights, and going wrong.

Both ROS packages have a link to this file.
"""

from typing import List, NamedTuple, Tuple

FAULTS = (
    "none",
    "wrong_status",  # the supervisor reports one wrong class
    "status_without_cause",  # the supervisor reports once on an id that no percentage had
    "request_without_change",  # the supervisor calls once for a status that was no change
    "silent_panel",  # the panel never answers its second request
)
COUNTDOWN = 101  # messages, from 100 % down to 0
UNKNOWN, HEALTHY, WARNING, CRITICAL = range(4)  # as in BatteryStatus
FAULTY_BELOW = 50.0  # percent, far from any change: at the first round there, a fault happens
OFFSET = 0.07  # of a period: how long after the first percentage the supervisor's rounds begin
LIGHTS = ("off", "green", "yellow", "red")  # by status
IGNORED_CALL = 2  # by a silent panel, counted from 1: the one for a warning


def known_fault(name: str) -> str:
    """The fault of this name, which may be another node's; ends the program where there is none."""
    if name not in FAULTS:
        raise SystemExit(f"unknown fault '{name}'; there are {', '.join(FAULTS)}")
    return name


def percentage(number: int) -> float:
    """The percentage of a battery's message, counted from 1."""
    return 100.0 - (number - 1) % COUNTDOWN


def status_of(percent: float) -> int:
    """The status that a percentage calls for."""
    return HEALTHY if percent > 40 else WARNING if percent > 30 else CRITICAL


class Report(NamedTuple):
    """A status and the id of its percentage, and whether it is another one than before."""

    cause: int
    status: int
    change: bool


class Supervision:
    """What a supervisor makes of the percentages that it takes."""

    def __init__(self, fault: str) -> None:
        self._fault = fault
        self._status = UNKNOWN

    def round(self, cause: int, percent: float) -> Tuple[List[Report], bool]:
        """What is to be reported, and whether to call for the light of this percentage's status."""
        fault = "none"
        if percent <= FAULTY_BELOW:
            fault, self._fault = self._fault, "none"
        status = status_of(percent)
        change = status != self._status
        self._status = status
        reports = [Report(cause, WARNING if fault == "wrong_status" else status, change)]
        if fault == "status_without_cause":
            reports.append(Report(0, status, False))
        return reports, change or fault == "request_without_change"


class Lights:
    """Which light is on."""

    def __init__(self, fault: str) -> None:
        self.cause, self.light = 0, LIGHTS[0]
        self._silent = fault == "silent_panel"
        self._calls = 0

    def ignores(self) -> bool:
        """Count a request, and say whether it is never answered."""
        self._calls += 1
        return self._silent and self._calls == IGNORED_CALL

    def show(self, cause: int, status: int) -> bool:
        """Show a status's light, and say whether there is one."""
        if status >= len(LIGHTS):
            return False
        self.cause, self.light = cause, LIGHTS[status]
        return True
