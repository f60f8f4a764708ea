"""Why a formula holds or does not: the values that decide it, and the parts that do, with the steps behind them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import msgspec

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.records import EventRecord, ReasonRecord, WhyRecord

_MAX_REASONS = 8
"""Reasons in one line."""

Recall = Callable[[int, int | None], EventRecord | None]


class Reason(msgspec.Struct, frozen=True, gc=False):
    """One part of the formula with values in place of variables, and whether it holds.

    `at` is a step that decides it: its number, or its time in nanoseconds with `time: seconds`; `step` its number where
    that is known; `window` are the first and the last of several, or of those among which there is none; `text` has
    this in words. `parts` decide it in turn.
    """

    formula: str
    holds: bool
    text: str
    at: int | None = None
    window: tuple[int, int] | None = None
    parts: tuple[Reason, ...] = ()
    step: int | None = None


class Why(msgspec.Struct, frozen=True, gc=False):
    """Why an outcome is as it is: `values` of quantified variables that decide it, None for any not seen yet.

    `others` counts the other values that would do as well.
    """

    holds: bool
    values: Mapping[str, Scalar | None]
    others: int
    reasons: tuple[Reason, ...]

    @property
    def text(self) -> str:
        """All in one line."""
        given = ", ".join(f"{name} = {_shown(value)}" for name, value in self.values.items())
        more = f" (and {self.others} more)" if self.others else ""
        found = [f"{r.formula}: {r.text}" for r in self.leaves]
        reasons = "; ".join(found[:_MAX_REASONS])
        if len(found) > _MAX_REASONS:
            reasons += f"; and {len(found) - _MAX_REASONS} more reasons"
        return f"for {given}{more}: {reasons}" if given else reasons

    @property
    def leaves(self) -> Iterator[Reason]:
        """The reasons without parts, each once."""
        return iter(dict.fromkeys(leaf for reason in self.reasons for leaf in _leaves(reason)))

    def data(self, recall: Recall) -> WhyRecord:
        """As plain data; `recall` returns the event of an `at` and a `step`, None where that is not known any more."""
        reasons = [_data(reason, recall) for reason in self.reasons]
        return {"values": dict(self.values), "other_values": self.others, "reasons": reasons}


def _leaves(reason: Reason) -> Iterator[Reason]:
    if not reason.parts:
        yield reason
    for part in reason.parts:
        yield from _leaves(part)


def _data(reason: Reason, recall: Recall) -> ReasonRecord:
    data: ReasonRecord = {"formula": reason.formula, "holds": reason.holds, "text": reason.text}
    if reason.at is not None:
        data["at"], data["event"] = reason.at, recall(reason.at, reason.step)
    if reason.window is not None:
        data["window"] = list(reason.window)
    if reason.parts:
        data["reasons"] = [_data(part, recall) for part in reason.parts]
    return data


def _shown(value: Scalar | None) -> str:
    if value is None:
        return "any other value"
    return msgspec.json.encode(value).decode()
