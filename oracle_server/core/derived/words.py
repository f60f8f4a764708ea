"""Derived signals in words: what they are, and what they are computed of at a step."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from oracle_server.core.derived.counts import Count
from oracle_server.core.derived.definition import MAX_SAMPLES, Definition
from oracle_server.core.derived.keyed import Keyed
from oracle_server.core.derived.machine import Machines
from oracle_server.core.derived.machinewords import machine_described, machine_told
from oracle_server.core.derived.sums import Sum
from oracle_server.core.derived.window import Series, Window
from oracle_server.core.events import Signals
from oracle_server.core.formula.tree import Position
from oracle_server.core.naming import value_text
from oracle_server.core.units import counted, span

_NAMES = {
    "sum": "the sum",
    "mean": "the mean",
    "min": "the least",
    "max": "the largest",
    "last": "the last",
    "previous": "the one before the last",
    "delta": "the change",
}


def described(definition: Definition) -> str:
    """A derived signal as its spec says it, in one line."""
    if definition.op == "expression":
        return definition.of
    if definition.table is not None:
        return machine_described(definition)
    over = "" if definition.over is None else f" over {_window(definition)}"
    by = f" by {definition.by[0]}" if definition.by else ""
    return f"{definition.op} of {definition.of}{over}{by}"


def told(definition: Definition, series: Series, signals: Signals, now: int, named: Callable[[int], str]) -> str:
    """What a derived signal is at a step or tick at `now` (ns), and what of; `named` names a step by its place."""
    value = signals.get(definition.name)
    if isinstance(series, Machines):
        return machine_told(definition, series, signals, now, named)
    own = series.series_of(signals) if isinstance(series, Keyed) else series
    begin = f"{definition.name} {'failed' if value is None else value_text(value)}"
    for by in definition.by:
        begin += f" for {by} {value_text(signals[by])}" if by in signals else ""
    if value is None:
        return f"{begin}: {_lack(definition, series, own)}"
    return f"{begin}: {_computed(definition, own, signals, now, named)}"


def lack(series: Series) -> str:
    """Why a derived signal has failed for want of room, empty where it has not."""
    if isinstance(series, Keyed | Machines):
        return series.lack
    return _no_room() if isinstance(series, Window) and series.short and series.failed_at is not None else ""


def _computed(
    definition: Definition, series: Series | None, signals: Signals, now: int, named: Callable[[int], str]
) -> str:
    if definition.op == "expression":
        values = [f"{name} = {value_text(signals[name])}" for name in definition.operands if name in signals]
        return ", ".join([definition.of, *values])
    if series is None:
        return f"{definition.of} never before"
    last = f"last at {named(series.last)}" if series.last else "never before"
    if definition.op == "age":
        return f"{definition.of} {last}"
    if isinstance(series, Count | Sum):
        what = definition.of if isinstance(series, Count) else f"{_NAMES[definition.op]} of {definition.of}"
        size = series.size(now)
        many = f"{size} of {what}" if isinstance(series, Count) else f"{what}, {counted(size, 'sample')}"
        return f"{many} in {_window(definition)}, {last}"
    if isinstance(series, Window):
        return f"{_NAMES[definition.op]} of {definition.of} in {_window(definition)}, {last}"
    return f"{_NAMES[definition.op]} of {definition.of}, {last}"


def _lack(definition: Definition, series: Series, own: Series | None) -> str:
    reason = lack(own or series) or lack(series)
    if reason:
        return reason
    if definition.op == "expression":
        return definition.of
    return f"a sample of {definition.of} has failed, or is no number"


def _window(definition: Definition) -> str:
    assert definition.over is not None  # noqa: S101 -- it has a window
    if not definition.counted:
        return span(definition.over)
    return counted(definition.over, "step" if definition.formula is not None else "sample")


def _no_room() -> str:
    return f"the windows of the session have more than {MAX_SAMPLES:,} samples"


def for_each(definition: Definition) -> Iterator[tuple[str, Position]]:
    """What is said of the variables in what is measured, which stand for any value, each with its place."""
    for atom in definition.tested:
        for key, variable in atom.refs:
            kept = "forget: 1h" if definition.over is None else f"over: {span(definition.over)}"
            yield (
                f"how often something comes is measured for all values of `{variable}` together; to tell it of each, "
                f"write it under `derive`, as in `often: {{{definition.op}: '{{…}}', {kept}, by: {key}}}`, and compare "
                "`often` in a formula, with `time: seconds`",
                atom.at,
            )
