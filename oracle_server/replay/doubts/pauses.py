"""Pauses of a recording that are far longer than all else in it, and recordings in which no time passes at all."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

from oracle_server.core.naming import moment
from oracle_server.core.spec import SECOND, Spec
from oracle_server.core.units import counted
from oracle_server.replay.recording import Note

_LEAST = 10 * SECOND
"""A shorter one (ns) is none."""
_TIMES = 100
"""How many times as long as all others it is, at least: what comes regularly has no such one."""
_AROUND = 100
"""So many messages before it and behind it tell what is regular; what comes in bursts has fewer together."""
_SEVERAL = 20
"""So many messages at least have more than one time, where they have their own."""
_MOST = 8
"""More than so many are none: each is as others are."""
_YEAR = 365 * 86_400 * SECOND
"""A longer one is told by `Leaps`."""


class _Gap(NamedTuple):
    """A time (ns) in which nothing arrived: how long, behind how many messages, from when, and until when."""

    length: int
    behind: int
    since: int
    until: int


class Pauses:
    """Looks at the times of arrival, and finds the few between which far more time passes than ever else."""

    def __init__(self) -> None:
        """Begin with nothing seen."""
        self._longest: list[_Gap] = []
        self._seen = self._last = 0
        self._times: set[int] = set()

    def look(self, time: int) -> None:
        """Look at the next time (ns); one that is earlier than those before is no matter."""
        gap = time - self._last
        if self._last and gap > 0 and (len(self._longest) <= _MOST or gap > self._longest[0].length):
            push = heapq.heappushpop if len(self._longest) > _MOST else heapq.heappush
            push(self._longest, _Gap(gap, self._seen, self._last, time))
        self._last = max(self._last, time)
        self._seen += 1
        self.published(time)

    def published(self, time: int | None) -> None:
        """Look at when a message was published (ns), where that is told."""
        if time is not None and len(self._times) < 2:
            self._times.add(time)

    def told(self, heard: Callable[[int, int], bool] = lambda _since, _until: False) -> Iterator[str]:
        """What is to be said of them, in a line; `heard` tells whether anything else arrived between two times (ns)."""
        found, usual = self._pauses()
        silent = [gap for gap in found if not heard(gap.since, gap.until)]
        if not silent:
            return
        first = min(silent, key=lambda gap: gap.since)
        what = f"nothing arrived for {first.length / SECOND:.6g} s, from {moment(first.since, first.until)}"
        what += f" to {moment(first.until, first.since)}"
        what += f" ({counted(len(silent), 'such pause')} in all)" if len(silent) > 1 else ""
        yield (
            f"{what}, and never else for more than {usual / SECOND:.3g} s: a clock was set, the recorder was paused, "
            "or messages are missing; deadlines between these times ran out"
        )

    def standing(self, spec: Spec) -> Iterator[Note]:
        """What is to be said where no time passes at all, and a spec asks how much does."""
        timed = [prop.id for prop in spec.properties if prop.time == "seconds"]
        if timed and self._seen >= _SEVERAL and len(self._times) == 1:
            what = f"all its {self._seen} messages arrived at the same time, {moment(self._last)}: none passes in it"
            yield Note(f"{what}, and what is asked of it was not judged ({', '.join(timed)})", doubt=True)

    def _pauses(self) -> tuple[list[_Gap], int]:
        """The pauses, and how long (ns) nothing arrived else."""
        ordered = sorted(self._longest, reverse=True)
        for number, (gap, shorter) in enumerate(itertools.pairwise(ordered), start=1):
            if gap.length >= max(_LEAST, _TIMES * shorter.length):
                return [g for g in ordered[:number] if self._is_amid(g) and g.length < _YEAR], shorter.length
        return [], 0

    def _is_amid(self, gap: _Gap) -> bool:
        return gap.behind >= _AROUND and self._seen - gap.behind >= _AROUND
