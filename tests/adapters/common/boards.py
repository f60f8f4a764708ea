"""A screen that keeps what is shown, and a clock that goes on when it is told to."""

from __future__ import annotations

from typing import Any, Dict, List, Sequence, Tuple

from oracle_adapter import Status

LATE = {"stream": "/odom", "kind": "topic", "seq": 17, "monitor": "m", "stamp": 10**18}
REVISION = {
    "n": 57,
    "step": None,
    "property": "near",
    "kind": "revision",
    "stamp": 10**18,
    "arrived": 10**18 + 310_999_999,
    "revises": {"from": 12, "to": 14},
    "because": [LATE],
    "causes": 1,
}
CAUSE = "/odom (topic 17 of m) came 310 ms late"


class Screen:
    """Keeps what is shown."""

    def __init__(self) -> None:
        self.verdicts: List[str] = []
        self.errors: List[str] = []
        self.infos: List[str] = []
        self.shown: List[List[Status]] = []

    def verdict(self, outcome: str) -> None:
        self.verdicts.append(outcome)

    def error(self, text: str) -> None:
        self.errors.append(text)

    def info(self, text: str) -> None:
        self.infos.append(text)

    def diagnostics(self, statuses: Sequence[Status]) -> None:
        self.shown.append(list(statuses))


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def told(worst: str, **levels: Tuple[str, str]) -> Dict[str, Any]:
    """A `verdicts` frame with each property's level and text."""
    properties = {
        name: {
            "outcome": "unknown",
            "level": level,
            "text": text,
            "violations": 2,
            "first_violation": 7,
        }
        for name, (level, text) in levels.items()
    }
    return {"n": 9, "worst": worst, "properties": properties}


def statuses(screen: Screen) -> Dict[str, Tuple[int, str]]:
    return {status.name: (status.level, status.message) for status in screen.shown[-1]}
