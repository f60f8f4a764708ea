"""What nobody publishes or serves, as where a spec misspells it: silence breaks nothing."""

from __future__ import annotations

import time
from difflib import SequenceMatcher
from functools import lru_cache
from heapq import nlargest
from typing import Callable, FrozenSet, Iterable, Optional, Sequence

PATIENCE = 10.0
"""Seconds for which a robot that starts may have nobody who publishes a topic."""
_NEAR = 0.6
"""How much alike names must be, of 1."""
_COMPARED = 5
"""How many names are compared closely: each takes a tenth of a millisecond, and events wait."""


class Unpublished:
    """Whether nobody has published a topic since this began; who did, and has gone, counts."""

    def __init__(
        self,
        name: str,
        clock: Callable[[], float] = time.monotonic,
        does: str = "publishes",
        proxy: str = "",
    ) -> None:
        """Begin with a topic's name on the graph, or an action's; `does`: what is wanted of it.

        `clock` returns seconds. Its `proxy` was not meant, whoever has that name.
        """
        self._name, self._clock, self._does, self._proxy = name, clock, does, proxy
        self._due: Optional[float] = clock() + PATIENCE
        self._others: FrozenSet[str] = frozenset()
        self._nearest: Sequence[str] = ()
        self.text = ""
        """What the last look found; empty where somebody has published it, or it is too early."""

    def look(
        self,
        published: Callable[[], bool],
        others: Callable[[], Iterable[str]],
        is_meant: Callable[[str], bool] = lambda _: True,
    ) -> None:
        """Look whether it is published by now.

        `others` are the topics that may have been meant, and `is_meant` tells of the few that are
        called alike whether one may have been.
        """
        if self._due is None:
            return
        if published():
            self._due, self.text = None, ""
        elif self._clock() >= self._due:
            self._due = self._clock() + PATIENCE
            found = frozenset(others()) - {self._proxy}
            if found != self._others:
                self._others, self._nearest = found, _nearest(self._name, found)
            meant = next(filter(is_meant, self._nearest), "")
            hint = f"; did you mean {meant}?" if meant else ""
            self.text = "" if self._name in found else f"nobody {self._does} {self._name}{hint}"


def _nearest(name: str, others: Iterable[str]) -> Sequence[str]:
    """The names that may have been meant, the likeliest first."""
    likeness = {other: _likeness(name, other) for other in _shortlist(name, others)}
    found = [other for other in likeness if likeness[other] >= _NEAR]
    return sorted(found, key=lambda other: (-likeness[other], other))


def _shortlist(name: str, others: Iterable[str]) -> Sequence[str]:
    """The few names that have most in common with this one."""
    pairs = _pairs(name)

    def common(other: str) -> float:
        if _is_elsewhere(name, other):
            return 1.0
        theirs = _pairs(other)
        return 2 * len(pairs & theirs) / (len(pairs) + len(theirs) or 1)

    return nlargest(_COMPARED, others, key=common)


@lru_cache(maxsize=4096)
def _pairs(name: str) -> FrozenSet[str]:
    """Each two letters of a name that stand side by side."""
    letters = name.lower()
    return frozenset(map("".join, zip(letters, letters[1:])))


def _likeness(name: str, other: str) -> float:
    """How much alike two names are, from 0 to 1, which a name in another namespace is."""
    if _is_elsewhere(name, other):
        return 1.0
    return SequenceMatcher(None, name.lower(), other.lower()).ratio()


def _is_elsewhere(name: str, other: str) -> bool:
    return name.endswith(other) or other.endswith(name)
