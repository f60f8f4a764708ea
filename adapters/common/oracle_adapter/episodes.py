"""Episodes, violations that follow each other closely: in words, and how long they are shown."""

from __future__ import annotations

from typing import Any, Callable, Dict, Mapping, Optional

from oracle_adapter.violations import time_text

SHOWN_AFTER = 10.0
"""Seconds after an episode for which diagnostics still show it."""


def episode_text(frame: Mapping[str, Any]) -> Optional[str]:
    """An `episode` frame in one line; None where nothing is to be told of it."""
    if frame.get("moved"):
        return None
    name, first, event = frame.get("property"), frame.get("first"), frame.get("event")
    at = time_text(frame.get("began") or 0)
    if event == "begun":
        return (
            f"violation: {frame.get('explanation') or f'{name} does not hold at {at}'} (#{first})"
        )
    if event == "retracted":
        return f"retracted: {name} was not violated at {at} (#{first}): what came late shows it"
    if event != "ended":
        return None
    until, last = frame.get("until"), frame.get("last")
    lasted = (
        at
        if until in (None, frame.get("began"))
        else f"from {at} on, and still at {time_text(until)}"
    )
    numbers = f"#{first}" if last in (None, first) else f"#{first} to #{last}"
    count = frame.get("count")
    times = "once" if count == 1 else f"{count} times"
    return f"over: {name} was violated {times}, {lasted}{_worst(frame.get('worst'))} ({numbers})"


def _worst(worst: Optional[Mapping[str, Any]]) -> str:
    if not worst:
        return ""
    if "robustness" in worst:
        return f", robustness {_number(worst['robustness'])}"
    than = f"{worst['than']} = " if worst.get("than") else ""
    wanted = f"{worst.get('op')} {than}{_number(worst.get('bound'))}"
    return f", at worst {worst.get('signal')} = {_number(worst.get('value'))}, wanted {wanted}"


def _number(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


class Recent:
    """The properties that are in an episode, or were not long ago, by `verdicts` frames."""

    def __init__(self, clock: Callable[[], float]) -> None:
        """Know of none; `clock` returns seconds."""
        self._clock = clock
        self._session = ""
        self._open: Dict[str, bool] = {}
        self._seen: Dict[str, float] = {}  # when an episode was last known of
        self._violations: Dict[str, int] = {}
        self.told = False
        """Whether the server tells of episodes: older ones don't."""

    def attached(self, session: str) -> None:
        """Forget the properties of another session."""
        if session != self._session:
            self._session = session
            self._open.clear()
            self._seen.clear()
            self._violations.clear()

    def take(self, properties: Mapping[str, Mapping[str, Any]]) -> None:
        """Take the state of the properties."""
        self.told = any("episode" in state for state in properties.values())
        for name, state in properties.items():
            episode, violations = state.get("episode"), int(state.get("violations") or 0)
            before = self._violations.get(name)
            known = bool(episode) if before is None else violations > before
            if self.told and (known or self._open.get(name)):
                self._seen[name] = self._clock()
            self._open[name] = bool(episode and episode.get("open"))
            self._violations[name] = violations

    def is_open(self, name: str) -> bool:
        """Whether a property is in an episode."""
        return bool(self._open.get(name))

    def was_open(self, name: str) -> bool:
        """Whether it was in one less than `SHOWN_AFTER` ago."""
        seen = self._seen.get(name)
        return seen is not None and self._clock() - seen < SHOWN_AFTER
