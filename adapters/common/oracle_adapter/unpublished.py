"""Topics that nobody publishes, as where a spec misspells one: what never comes breaks nothing."""

from __future__ import annotations

import time
from difflib import SequenceMatcher
from typing import Callable, Iterable, Optional

PATIENCE = 10.0
"""Seconds for which a robot that starts may have nobody who publishes a topic."""
_NEAR = 0.6
"""How much alike names must be, of 1."""


class Unpublished:
    """Whether nobody has published a topic since this began; who did, and has gone, counts."""

    def __init__(self, name: str, clock: Callable[[], float] = time.monotonic) -> None:
        """Begin with a topic's name on the graph. `clock` returns seconds."""
        self._name, self._clock = name, clock
        self._due: Optional[float] = clock() + PATIENCE
        self.text = ""
        """What the last look found; empty where somebody has published it, or it is too early."""

    def look(self, published: Callable[[], bool], others: Callable[[], Iterable[str]]) -> None:
        """Look whether it is published by now; `others` are the topics that may have been meant."""
        if self._due is None:
            return
        if published():
            self._due, self.text = None, ""
        elif self._clock() >= self._due:
            found = list(others())
            self._due = self._clock() + PATIENCE
            self.text = "" if self._name in found else _text(self._name, found)


def _text(name: str, others: Iterable[str]) -> str:
    meant = max(others, key=lambda other: _likeness(name, other), default="")
    hint = f"; did you mean {meant}?" if meant and _likeness(name, meant) >= _NEAR else ""
    return f"nobody publishes {name}{hint}"


def _likeness(name: str, other: str) -> float:
    """How much alike two names are, from 0 to 1, which a name in another namespace is."""
    if name.endswith(other) or other.endswith(name):
        return 1.0
    return SequenceMatcher(None, name.lower(), other.lower()).ratio()
