"""`&&`, `||`, `!` and choices as closures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from oracle_server.core.expression.cost import CAUGHT, Frame, charge
from oracle_server.core.expression.loops import Run, truth, worse
from oracle_server.core.expression.stops import Exhausted, Stopped
from oracle_server.core.expression.values import unfit


class _Rule(NamedTuple):
    """What decides, whatever the other parts are; what the value is where nothing does; what is said of other kinds."""

    decides: bool
    why: str


def joined(mark: str, parts: list[Run]) -> Run:
    """`||`, which a part that is true decides, or `&&`, which one that is false does, whatever the others are."""
    rule = _Rule(mark == "||", f"`{mark}` takes what is true or false")
    if len(parts) == 2:
        return _two(rule, *parts)
    return lambda message, frame: _several(rule, message, frame, parts, None)


def _several(rule: _Rule, message: Mapping[str, Any], frame: Frame, parts: list[Run], stop: Stopped | None) -> bool:
    for part in parts:
        try:
            value = part(message, frame)
        except Exhausted:
            raise
        except Stopped as error:
            charge(frame, CAUGHT)
            stop = worse(stop, error)
            continue
        if value is True or value is False:
            if value == rule.decides:
                return rule.decides
        else:
            stop = worse(stop, unfit(rule.why, value))
    if stop is not None:
        raise stop
    return not rule.decides


def _two(rule: _Rule, one: Run, other: Run) -> Run:
    """The common case."""
    decides, why = rule
    last = [other]

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        try:
            value = one(message, frame)
        except Exhausted:
            raise
        except Stopped as error:
            charge(frame, CAUGHT)
            return _several(rule, message, frame, last, error)
        if value is True or value is False:
            if value == decides:
                return decides
            value = other(message, frame)
            if value is True or value is False:
                return value
            raise unfit(why, value)
        return _several(rule, message, frame, last, unfit(why, value))

    return run


def negation(of: Run) -> Run:
    """`!of`."""
    return lambda message, frame: not truth(of(message, frame), "`!` takes what is true or false")


def choice(cases: list[tuple[Run, Run]], otherwise: Run) -> Run:
    """The value of the first case that holds."""
    why = "`?` takes what is true or false before it"

    def several(message: Mapping[str, Any], frame: Frame) -> Any:
        for test, value in cases:
            holds = test(message, frame)
            if holds is True:
                return value(message, frame)
            if holds is not False:
                raise unfit(why, holds)
        return otherwise(message, frame)

    return several
