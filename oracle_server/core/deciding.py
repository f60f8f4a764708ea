"""When outcomes deny an event, and what a step that is denied and taken back must not change."""

from __future__ import annotations

from typing import NamedTuple

from oracle_server.core.holding import Held
from oracle_server.core.property_state import Mark
from oracle_server.core.verdicts import DENYING, NEGATIVE, Decision, Outcome


class Before(NamedTuple):
    """What a step that is taken back must not change."""

    marks: list[Mark]
    present: int
    steps: int
    held: dict[str, Held]
    ticked: int
    outdated: bool


def denies(outcome: Outcome, *, blamed: bool) -> bool:
    """Whether an outcome of a guard denies an event, which is to `blame` for what is negative or not."""
    return outcome in DENYING and (blamed or outcome not in NEGATIVE)


def is_denied(decision: Decision | None) -> bool:
    """Whether an event was asked about, and denied."""
    return decision is not None and decision.choice == "deny"
