"""Who decided what of a session, and whether two servers did at the same time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import permutations
from typing import NamedTuple


class Ruling(NamedTuple):
    """A decision: when its event was sent last, when it was read (s, monotonic), and the process that told it."""

    asked: float
    read: float
    process: str


def two_at_once(rulings: Iterable[Ruling]) -> list[str]:
    """Of a session's decisions, pairs of processes of which one decided before and after the other one.

    A process never gets a session back, and what it decided lies between `asked` and `read`. So one that decides
    what was asked after another one's decision had been read, and had itself decided before that was asked, had the
    session while the other one had it.
    """
    by: dict[str, list[Ruling]] = {}
    for ruling in rulings:
        by.setdefault(ruling.process, []).append(ruling)
    return [f"{one}, {other}" for one, other in permutations(by, 2) if _surrounds(by[one], by[other])]


def _surrounds(one: Sequence[Ruling], other: Sequence[Ruling]) -> bool:
    first, last = min(ruling.read for ruling in one), max(ruling.asked for ruling in one)
    return any(first < ruling.asked and ruling.read < last for ruling in other)
