"""What one message can be twice: events of one topic, whose predicates may both hold, or never do."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from oracle_server.specfiles.hpl.tree import (
    Binary,
    Event,
    Events,
    Expr,
    Group,
    Number,
    Range,
    Reference,
    Text,
    Truth,
    Unary,
)

_FLIPPED = {"<": ">", "<=": ">=", ">": "<", ">=": "<=", "=": "=", "!=": "!="}
_Value = str | float | bool
_Key = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class _Fact:
    """What is known of a field: one of some values; or a number between two, of which either may be out."""

    values: frozenset[tuple[str, _Value]] | None = None
    low: tuple[float, bool] = (-math.inf, False)
    high: tuple[float, bool] = (math.inf, False)

    def misses(self, other: _Fact) -> bool:
        """Whether no value meets both."""
        if self.values is not None:
            return not any(other._has(value) for value in self.values)
        if other.values is not None:
            return other.misses(self)
        (low, above), (high, below) = (
            max(self.low, other.low),
            min(self.high, other.high, key=lambda end: (end[0], not end[1])),
        )
        return low > high or (low == high and (above or below))

    def _has(self, value: tuple[str, _Value]) -> bool:
        if self.values is not None:
            return value in self.values
        kind, number = value
        if kind != "number":
            return False
        (low, above), (high, below) = self.low, self.high
        assert isinstance(number, float)  # noqa: S101 -- of this kind
        return (low < number or (low == number and not above)) and (number < high or (number == high and not below))


def conjuncts(expr: Expr | None) -> list[Expr]:
    """The parts of a predicate that must all hold."""
    if expr is None:
        return []
    if isinstance(expr, Binary) and expr.sign == "and":
        return [*conjuncts(expr.left), *conjuncts(expr.right)]
    return [expr]


def both(some: Events, others: Events) -> Iterator[tuple[Event, Event]]:
    """Pairs of events that one message may be, as far as can be told."""
    for one in some:
        yield from ((one, other) for other in others if one.topic == other.topic and not _apart(one, other))


def implies(one: Event, other: Event) -> bool:
    """Whether each message that is one event is surely the other."""
    known = conjuncts(one.predicate)
    return one.topic == other.topic and all(part in known for part in conjuncts(other.predicate))


def _apart(one: Event, other: Event) -> bool:
    """Whether no message is both: what both say of a field excludes each other."""
    ours, theirs = conjuncts(one.predicate), conjuncts(other.predicate)
    if any(_denied(part) in theirs for part in ours) or any(_denied(part) in ours for part in theirs):
        return True
    known = [found for part in theirs if (found := _fact(part)) is not None]
    facts = [found for part in ours if (found := _fact(part)) is not None]
    return any(key == other_key and fact.misses(other_fact) for key, fact in facts for other_key, other_fact in known)


def _denied(expr: Expr) -> Expr:
    """The opposite of a part; what is no comparison with `!=` is what `not` would stand before."""
    if isinstance(expr, Binary) and expr.sign == "!=":
        return Binary(expr.at, expr.end, "=", expr.left, expr.right)
    return Unary(expr.at, expr.end, "not", expr)


def _fact(expr: Expr) -> tuple[_Key, _Fact] | None:
    match expr:
        case Reference(alias="") if _plain(expr):
            return expr.steps, _one(Truth(0, 0, True))
        case Unary(sign="not", operand=Reference(alias="") as field) if _plain(field):
            return field.steps, _one(Truth(0, 0, False))
        case Binary(left=Reference(alias="") as field, right=value) if _plain(field):
            return _compared(field, expr.sign, value)
        case Binary(left=value, right=Reference(alias="") as field) if _plain(field) and expr.sign in _FLIPPED:
            return _compared(field, _FLIPPED[expr.sign], value)
        case _:
            return None


def _plain(field: Reference) -> bool:
    return all(isinstance(step, str | Number) for step in field.steps)


def _compared(field: Reference, sign: str, value: Expr) -> tuple[_Key, _Fact] | None:
    if sign == "=" and _literal(value) is not None:
        return field.steps, _one(value)
    if sign == "in" and isinstance(value, Group):
        found = [_literal(item) for item in value.items]
        return None if None in found else (field.steps, _Fact(frozenset(each for each in found if each is not None)))
    if sign == "in" and isinstance(value, Range):
        low, high = _number(value.low), _number(value.high)
        known = low is not None and high is not None
        return (field.steps, _Fact(None, (low or 0.0, value.above), (high or 0.0, value.below))) if known else None
    number = _number(value)
    if number is None or sign not in ("<", "<=", ">", ">="):
        return None
    end = (number, len(sign) == 1)
    return field.steps, _Fact(None, high=end) if sign[0] == "<" else _Fact(None, low=end)


def _one(value: Expr) -> _Fact:
    found = _literal(value)
    return _Fact(frozenset([found] if found else []))


def _literal(expr: Expr) -> tuple[str, _Value] | None:
    number = _number(expr)
    if number is not None:
        return "number", number
    if isinstance(expr, Text):
        return "text", expr.value
    return ("truth", expr.value) if isinstance(expr, Truth) else None


def _number(expr: Expr) -> float | None:
    if isinstance(expr, Unary) and expr.sign == "-":
        found = _number(expr.operand)
        return None if found is None else -found
    return float(expr.text) if isinstance(expr, Number) and len(expr.text) <= 15 else None
