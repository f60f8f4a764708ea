"""The snapshot of a session as plain data: what later verdicts depend on, but for what is held in the order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NotRequired, TypedDict

from oracle_server.core.events import Order, StreamKey
from oracle_server.core.formula.tree import Scalar


class WatchSnapshot(TypedDict):
    """What a property of which nothing was asked yet waits for; `missing` are the places of atoms that never held."""

    asked: bool
    missing: list[int]


class PropertySnapshot(TypedDict):
    """One property; `engine` is None where it needs none any more. The fields are those of `PropertyState`.

    Older versions lack where the first violation was, and whether denied events may still count: then they may.
    `watch` is None where something was asked of it, and lacking where an older version did not look.
    """

    outcome: str
    negative: bool
    first_violation: int | None
    first_violation_step: NotRequired[int | None]
    first_violation_at: NotRequired[int | None]
    violations: int
    failures: int
    broken: str | None
    renewed: bool
    stained: NotRequired[bool]
    watch: NotRequired[WatchSnapshot | None]
    engine: dict[str, Any] | None


class JudgeSnapshot(TypedDict):
    """One order of events; times in nanoseconds.

    `held` has a monitor each, the values of its held signals, and the names of those that failed. `recent` are the
    last steps as `Recent` has them, `derived` is what derived signals are computed of, where there are any, and
    `episodes` are those that may go on; older versions lack them.
    """

    properties: list[PropertySnapshot]
    held: Sequence[tuple[str, dict[str, Scalar], list[str]]]
    counters: dict[str, int]
    degraded: bool
    present: int
    ticked: int
    outdated: bool
    recent: list[Any]
    derived: NotRequired[Any]
    episodes: NotRequired[Any]


class RevisingSnapshot(TypedDict):
    """A judge that revises, as of before the first row that it keeps: it can still go back to any that is newer.

    `position` is that of the last row before them, and `included` are late events after it that were put in places
    before them; `deadline` is the latest that was told (ns) before the first of those rows that is not in order, or the
    latest of all. `before` and `floor` are as in `Point` and `Keeping`, `finals` those of `RevisableState`.

    The counters are of all rows up to the position `counted`, behind which it is `degraded` by what was lost. Older
    versions lack both; what they saved last was mostly saved behind the last row, when they were stopped. They lack
    `beneath` too: their engines took no steps once it was said that a property is negative for good.
    """

    judge: JudgeSnapshot
    position: int
    included: list[int]
    floor: int
    deadline: int
    before: int
    numbered: int
    counted: NotRequired[int]
    degraded: NotRequired[bool]
    finals: Sequence[tuple[str | None, int, bool]]
    beneath: NotRequired[bool]


class SessionSnapshot(TypedDict):
    """A session; times in nanoseconds. `counts` has a monitor and a stream each: what came late, and what was lost.

    `revising` is in the place of `judges` where the spec revises.
    """

    judges: dict[Order, JudgeSnapshot]
    revising: NotRequired[RevisingSnapshot]
    present: int | None
    now: int
    counts: Sequence[tuple[str, StreamKey, int, int]]
