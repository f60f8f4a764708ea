"""When outcomes deny an event, and what a step that is denied and taken back must not change."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from oracle_server.core.episode import Following
from oracle_server.core.judging.holding import Version
from oracle_server.core.verdicts import NEGATIVE, Decision, Outcome, Verdict


class Mark(NamedTuple):
    """The part of a property's state that a step which is taken back must not change."""

    outcome: Outcome
    negative: bool
    failures: int
    violations: int
    first: tuple[int | None, int | None, int | None]


class Before(NamedTuple):
    """What a step that is taken back must not change."""

    marks: list[Mark]
    present: int
    steps: int
    held: Version
    ticked: int
    outdated: bool
    following: Following


def denies(outcome: Outcome, *, blamed: bool, breaks: bool) -> bool:
    """Whether an outcome of a guard denies an event, which is to `blame` for what is negative or not.

    `breaks`: the event broke what is asked by `always`, whether or not that is negative once more.
    """
    return outcome is Outcome.UNKNOWN or (blamed and (breaks or outcome in NEGATIVE))


def attempted(verdict: Verdict, owes: Outcome | None) -> Verdict:
    """A verdict about an attempt that is taken back: it is not final, and no obligation was decided by it.

    `owes` is the outcome without those of a property that waits for what comes, and did not deny the attempt.
    """
    if owes is not None and verdict.outcome in NEGATIVE:
        return msgspec.structs.replace(verdict, outcome=owes, explanation=None)
    return msgspec.structs.replace(verdict, outcome=verdict.outcome.current)


def is_denied(decision: Decision | None) -> bool:
    """Whether an event was asked about, and denied."""
    return decision is not None and decision.choice == "deny"
