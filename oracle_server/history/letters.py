"""Outcomes as letters, one a property: in rows, in blocks, and in answers by time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from oracle_server.core.verdicts import Outcome

LETTERS: Mapping[Outcome | None, str] = {
    Outcome.TRUE: "T",
    Outcome.CURRENTLY_TRUE: "t",
    Outcome.CURRENTLY_FALSE: "f",
    Outcome.FALSE: "F",
    Outcome.UNKNOWN: "u",
    None: "-",
}
"""By the outcome; None where there is none: the deadline is retracted, or a revision does not change the property."""


def letters(outcomes: Sequence[Outcome | None]) -> str:
    """Outcomes as a text, a character each."""
    return "".join([LETTERS[outcome] for outcome in outcomes])
