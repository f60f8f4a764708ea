"""Why a formula holds or does not: the values that decide it, and the parts that do, with the steps behind them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Literal

import msgspec

from oracle_server.core.formula.tree import Scalar
from oracle_server.core.naming import value_text
from oracle_server.core.records import EventRecord, FailingRecord, ReasonRecord, WhyRecord

_MAX_REASONS = 8
"""Reasons in one line."""

Recall = Callable[[int, int | None], EventRecord | None]


class Failing(msgspec.Struct, frozen=True, gc=False):
    """A constraint that a step did not meet: the signal, its value there, and what was wanted.

    `value` is None where the signal is `missing`: absent, or not computed since its expression failed. `wanted` is None
    where any value would do, or any that was not seen before; it is the value of the signal `than`, where there is one.
    """

    signal: str
    op: str
    wanted: Scalar | None
    value: Scalar | None
    missing: Literal["absent", "failed"] | None = None
    than: str = ""

    @property
    def text(self) -> str:
        """In words."""
        if self.value is None:
            return f"`{self.signal}` {'is absent' if self.missing == 'absent' else 'could not be computed'}"
        wanted = "any other value" if self.wanted is None else value_text(self.wanted)
        op = "" if self.op == "==" else f"{self.op} "
        op += f"{self.than} = " if self.than else ""
        return f"{self.signal} = {value_text(self.value)}, wanted {op}{wanted}"

    def data(self) -> FailingRecord:
        """As plain data."""
        data: FailingRecord = {"signal": self.signal, "op": self.op, "wanted": self.wanted, "value": self.value}
        if self.than:
            data["than"] = self.than
        if self.missing:
            data["missing"] = self.missing
        return data


class Reason(msgspec.Struct, frozen=True, gc=False):
    """One part of the formula with values in place of variables, and whether it holds.

    `at` is a step that decides it: its number, or its time in nanoseconds with `time: seconds`; `step` its number where
    that is known; `unnumbered`: these are the numbers of an attempt that is taken back; `window` are the first and the
    last of several, or of those among which there is none; `text` has this in words. `failing` are the constraints of
    an atom that fail at the step. `parts` decide it in turn; `told`: it is told in one line with them, and before them.
    """

    formula: str
    holds: bool
    text: str
    at: int | None = None
    window: tuple[int, int] | None = None
    parts: tuple[Reason, ...] = ()
    step: int | None = None
    failing: tuple[Failing, ...] = ()
    unnumbered: bool = False
    told: bool = False


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
        """The reasons without parts, and others that are told, each once."""
        return iter(dict.fromkeys(leaf for reason in self.reasons for leaf in _leaves(reason)))

    def data(self, recall: Recall) -> WhyRecord:
        """As plain data; `recall` returns the event of an `at` and a `step`, None where that is not known any more."""
        reasons = [_data(reason, recall) for reason in self.reasons]
        return {"values": dict(self.values), "other_values": self.others, "reasons": reasons}


def _leaves(reason: Reason) -> Iterator[Reason]:
    if reason.told or not reason.parts:
        yield reason
    for part in reason.parts:
        yield from _leaves(part)


def _data(reason: Reason, recall: Recall) -> ReasonRecord:
    data: ReasonRecord = {"formula": reason.formula, "holds": reason.holds, "text": reason.text}
    if reason.at is not None:
        if not reason.unnumbered:
            data["at"] = reason.at
        data["event"] = recall(reason.at, reason.step)
    if reason.window is not None:
        data["window"] = list(reason.window)
    if reason.failing:
        data["failing"] = [each.data() for each in reason.failing]
    if reason.parts:
        data["reasons"] = [_data(part, recall) for part in reason.parts]
    return data


def _shown(value: Scalar | None) -> str:
    if value is None:
        return "any other value"
    return value_text(value)
