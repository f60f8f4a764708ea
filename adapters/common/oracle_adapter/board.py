"""What people see of the oracle on the robot: verdict, errors, diagnostics, as texts and levels.

The server describes the state of properties; the board adds whether the server is connected. A ROS
adapter passes the callbacks of a `Board` to its `Link`, and a `Screen` to the board.
"""

from __future__ import annotations

import re
import threading
import time
from dataclasses import asdict
from typing import TYPE_CHECKING, Any, Callable, Dict, Iterable, List, Mapping, Tuple

from oracle_adapter.decision import should_pass
from oracle_adapter.episodes import SHOWN_AFTER, Recent, episode_text
from oracle_adapter.outage import Outages
from oracle_adapter.screen import ERROR, LEVELS, OK, STALE, WARN, SafeScreen, Status
from oracle_adapter.violations import Violations, first_text

if TYPE_CHECKING:
    from oracle_adapter.decision import Answer, Policy, Why
    from oracle_adapter.exchange import State
    from oracle_adapter.screen import Screen
    from oracle_adapter.stats import Stats

UNKNOWN = "unknown"
DIAGNOSTICS_PERIOD = 1.0
"""Seconds between diagnostics where nothing changes: their viewers expect one a second."""


def graph_name(monitor: str) -> str:
    """The namespace of a monitor's topics: its name, where what ROS does not allow is a `_`."""
    parts = [re.sub("[^A-Za-z0-9]+", "_", part) for part in monitor.split("/") if part]
    return "".join(f"/_{part}" if part[0].isdigit() else f"/{part}" for part in parts) or "/monitor"


_FINE = (OK, "recovered")
"""The level and the text of a stream with which nothing is wrong any more."""


class Board:
    """Takes the link's news and what was done with events, and shows it on a screen."""

    def __init__(
        self, monitor: str, screen: Screen, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """Show an unknown verdict. `clock` returns seconds."""
        self._monitor, self._screen, self._clock = monitor, SafeScreen(screen), clock
        self._lock = threading.Lock()  # guards what follows; nothing is shown under it
        self._outages = Outages(clock)
        self._violations = Violations()  # of the link's thread alone
        self._recent = Recent(clock)
        self._attached, self._detail = False, "not attached yet"
        self._properties: Mapping[str, Mapping[str, Any]] = {}
        self._troubles: Dict[str, Tuple[int, str]] = {}  # the level and the text
        self._failures: Dict[str, int] = {}  # events that could not be passed on, by stream
        self._shown: List[Tuple[str, int, str]] = []
        self._shown_at = -DIAGNOSTICS_PERIOD
        self._verdict = UNKNOWN
        self._screen.verdict(UNKNOWN)

    # For the link, as its callbacks

    def on_verdicts(self, frame: Mapping[str, Any]) -> None:
        """Show the state of the properties; what can't be read is unknown, and a trouble."""
        why = ""
        with self._lock:
            try:
                self._properties, worst = frame["properties"], str(frame["worst"])
                self._recent.take(self._properties)
                self._property_statuses()
            except Exception as error:  # noqa: BLE001 - whatever a server sends
                self._properties, worst = {}, UNKNOWN
                why = f"what the oracle says of them can't be read: {error!r}"
        self._show_verdict(worst)
        self.trouble("properties", why)

    def on_violation(self, record: Mapping[str, Any]) -> None:
        """Show a violation, of a server that does not tell of episodes."""
        self._screen.error(self._violations.told(record))

    def on_episode(self, frame: Mapping[str, Any]) -> None:
        """Show that violations begin, that they are over, or that they were none."""
        text = episode_text(frame)
        if text is not None:
            self._screen.error(text)

    def on_revision(self, record: Mapping[str, Any]) -> None:
        """Show what was taken back; a violation that appears is told as one, or as an episode."""
        if record.get("retracted") and not self._recent.told:
            self._screen.error(self._violations.retracted(record))

    def on_state(self, state: State, detail: str) -> None:
        """Show whether the oracle is connected; without a connection the verdict is unknown."""
        if state == "attached":
            self._violations.attached(detail)
        with self._lock:
            self._attached, self._detail = state == "attached", detail
            if self._attached:
                self._recent.attached(detail)
            over = self._outages.over() if self._attached else None
        self._screen.info(f"oracle: {detail if detail.startswith(state) else f'{state} {detail}'}")
        if over:
            self._screen.info(over)
        if state != "attached":
            self._show_verdict(UNKNOWN)

    # For the adapter

    def settle(self, answer: Answer, on_unavailable: Policy, event: str) -> Tuple[bool, Why]:
        """Return whether an event passes and why, and show it where it is denied.

        `event` names it for people, as in `a request of /SetLED, call 3`. Without an oracle, what
        is done with events is shown for the first of them only, and counted.
        """
        passed, why = should_pass(answer, on_unavailable)
        if why != "decision":
            with self._lock:
                begins = self._outages.undecided(passed=passed)
            if begins:
                done = "passed" if passed else "denied"
                more = "until the oracle is back, more of this is counted and not shown"
                self._screen.error(f"{done} {event}: {answer.reason}; {more}")
            return passed, why
        with self._lock:
            over = self._outages.over()
        if over:
            self._screen.info(over)
        if not passed:
            self._screen.error(f"denied {event}: {', '.join(answer.denied_by) or answer.reason}")
        return passed, why

    def failed(self, stream: str, event: str, error: Exception) -> None:
        """Count an event that could not be passed on, and show the first one of a stream."""
        with self._lock:
            count = self._failures[stream] = self._failures.get(stream, 0) + 1
        if count == 1:
            more = "more of this stream is counted and not shown"
            self._screen.error(f"{event} could not be passed on: {error!r}; {more}")

    def error(self, text: str) -> None:
        """Show an error of the adapter's own."""
        self._screen.error(text)

    def trouble(self, subject: str, text: str, doubt: str = "") -> bool:
        """Show what is wrong with a stream, an empty text for nothing; return whether it is new.

        `doubt`: what may be wrong, which is a warning where nothing else is wrong.
        """
        now = (ERROR, text) if text else (WARN, doubt) if doubt else _FINE
        with self._lock:
            before = self._troubles.get(subject, _FINE)
            if now != _FINE or subject in self._troubles:
                self._troubles[subject] = now
        if now == before:
            return False
        show = self._screen.error if text else self._screen.info
        show(f"{subject}: {now[1]}")
        return True

    def keep(self, subjects: Iterable[str]) -> None:
        """Forget what was wrong with all other streams, as they are not observed any more."""
        kept = set(subjects)
        with self._lock:
            self._troubles = {name: told for name, told in self._troubles.items() if name in kept}

    def tick(self, stats: Stats) -> None:
        """Show diagnostics where they changed, else every second; call it ten times a second."""
        with self._lock:
            statuses = [self._link_status(stats)]
            statuses += self._property_statuses() + self._trouble_statuses()
            shown = [(status.name, status.level, status.message) for status in statuses]
            now = self._clock()
            if shown == self._shown and now - self._shown_at < DIAGNOSTICS_PERIOD:
                return
            self._shown, self._shown_at = shown, now
        self._screen.diagnostics(statuses)

    # Inside

    def _show_verdict(self, outcome: str) -> None:
        with self._lock:
            before, self._verdict = self._verdict, outcome
        if outcome != before:
            self._screen.verdict(outcome)

    def _link_status(self, stats: Stats) -> Status:
        counters = {
            **asdict(stats),
            "passed without a decision": self._outages.total.passed,
            "denied without a decision": self._outages.total.denied,
            "failed to pass on": sum(self._failures.values()),
        }
        level, message = OK, f"attached to session {self._detail}"
        if not self._attached:
            level, message = STALE, f"the oracle is away: {self._detail}"
        elif self._outages.lasting:
            level, message = STALE, "attached, but the oracle does not decide in time"
        values = tuple((name, str(value)) for name, value in counters.items())
        return Status(f"{self._monitor}: oracle", level, message, values)

    def _property_statuses(self) -> List[Status]:
        return [self._property_status(name, state) for name, state in self._properties.items()]

    def _property_status(self, name: str, state: Mapping[str, Any]) -> Status:
        level, message = LEVELS.get(state["level"], STALE), str(state["text"])
        if not self._attached:
            level, message = STALE, f"the oracle is away; when it was last connected: {message}"
        elif self._recent.is_open(name):
            level = max(WARN, level) if level != STALE else WARN
        elif self._recent.was_open(name) and level == OK:
            level, message = WARN, f"{message}; it did not less than {SHOWN_AFTER:.0f} s ago"
        values = (
            ("outcome", str(state.get("outcome"))),
            ("violations", str(state.get("violations"))),
            ("first at", first_text(state)),
            ("first_violation", str(state.get("first_violation"))),
        )
        return Status(f"{self._monitor}: {name}", level, message, values)

    def _trouble_statuses(self) -> List[Status]:
        return [
            Status(f"{self._monitor}: {name}", level, text)
            for name, (level, text) in self._troubles.items()
        ]
