"""Comparisons as closures, the common ones with a number or a text that is written out apart."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from oracle_server.core.expression.cost import Frame
from oracle_server.core.expression.loops import Run
from oracle_server.core.expression.stops import Failed
from oracle_server.core.expression.tree import Compare, ListOf, Literal
from oracle_server.core.expression.values import (
    NO_ORDER,
    NOT_FINITE,
    ORDER,
    contained,
    is_number,
    number,
    ordered,
    same,
    unfit,
)


def compare(node: Compare, left: Run, right: Run) -> tuple[Run, bool]:
    """The closure of a comparison of these operands, and whether its cost depends on the message."""
    other = node.right
    if node.mark == "in":
        if isinstance(other, ListOf) and all(isinstance(item, Literal) for item in other.items):
            return _one_of([item.value for item in other.items if isinstance(item, Literal)], left), False
        return lambda message, frame: contained(left(message, frame), right(message, frame), frame), True
    if isinstance(other, Literal) and is_number(other.value):
        return _with_number(node.mark, left, other.value), False
    if node.mark in ORDER:
        in_order = ordered(node.mark)
        return lambda message, frame: in_order(left(message, frame), right(message, frame), frame), True
    wanted = node.mark == "=="
    if isinstance(other, Literal) and isinstance(other.value, str):
        return _with_text(other.value, left, wanted=wanted), False
    return lambda message, frame: same(left(message, frame), right(message, frame), frame) is wanted, True


def _with_number(mark: str, left: Run, wanted: Any) -> Run:
    holds = ORDER.get(mark)
    if holds is None:
        return _equal_number(left, wanted, wanted=mark == "==")
    in_order, why = holds, f"`{mark}` takes two numbers or two texts"

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        value = left(message, frame)
        if type(value) is int or (type(value) is float and value == value):  # noqa: PLR0124 -- NaN
            return in_order(value, wanted)
        found = number(value)
        if type(found) is not float:
            raise unfit(why, value, wanted)
        if found != found:  # noqa: PLR0124 -- NaN
            raise Failed(NO_ORDER, value, wanted)
        return in_order(found, wanted)

    return run


def _equal_number(left: Run, number: Any, *, wanted: bool) -> Run:
    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        value = left(message, frame)
        return ((type(value) is int or type(value) is float) and value == number) is wanted

    return run


def _with_text(text: str, left: Run, *, wanted: bool) -> Run:
    if text in NOT_FINITE:
        meant = NOT_FINITE[text]
        return lambda message, frame: ((value := left(message, frame)) == text or value == meant) is wanted
    if wanted:
        return lambda message, frame: bool(left(message, frame) == text)
    return lambda message, frame: bool(left(message, frame) != text)


def _one_of(values: list[Any], left: Run) -> Run:
    numbers = frozenset(number(v) for v in values if is_number(number(v)) and v != "NaN")
    texts = frozenset(v for v in values if isinstance(v, str))
    longest = max(map(len, texts), default=0)
    others = [v for v in values if v is None or isinstance(v, bool)]

    def run(message: Mapping[str, Any], frame: Frame) -> bool:
        value = left(message, frame)
        kind = type(value)
        if kind is str:
            return len(value) <= longest and value in texts
        if kind is int or kind is float:
            return value in numbers
        return any(value is other for other in others)

    return run
