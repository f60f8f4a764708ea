"""Reasons as trees: what stands at their ends, and of which steps they speak."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from oracle_server.core.explanation import Reason


def leaves(reasons: Iterable[Reason]) -> Iterator[Reason]:
    """The reasons without parts."""
    for reason in reasons:
        if reason.parts:
            yield from leaves(reason.parts)
        else:
            yield reason


def size(reasons: Sequence[Reason]) -> int:
    """How many these are."""
    return sum(1 for _ in leaves(reasons))


def spots(reasons: Iterable[Reason]) -> Iterator[tuple[int, int]]:
    """The first and the last time of each reason that has any."""
    for reason in reasons:
        if reason.at is not None:
            yield reason.at, reason.at
        if reason.window is not None:
            yield reason.window
        yield from spots(reason.parts)
