"""Messages to signals: what formulas see of an event.

A signal is a string, a boolean or a finite number. A field that is missing or null makes its signal absent; an
expression that fails, or a value that is none of those, makes it `failed`, and whatever reads it unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from oracle_server.core.errors import ExpressionError
from oracle_server.core.events import Projected
from oracle_server.core.expression import (
    MAX_ROWS,
    MAX_STEPS,
    Absent,
    Expression,
    absent_at_an_element,
    no_signal,
    parse_expression,
    reason,
    told,
    too_dear,
)
from oracle_server.core.formula.tree import Scalar

_NOT_FINITE = frozenset({"NaN", "Infinity", "-Infinity"})
_INTEGERS = range(-(2**63), 2**64)
_NO_FIELDS: Mapping[str, Any] = {}
_NONE: frozenset[str] = frozenset()


class Projection:
    """Computes the signals of one stream from its messages, within a bound on what an event may cost."""

    def __init__(self, signals: Mapping[str, str], each: Expression | None = None) -> None:
        """Compile `signals`, expressions by name, of the elements of `each`, if given. Raises `ExpressionError`."""
        self._expressions = {name: parse_expression(text, each=each) for name, text in signals.items()}
        dear = too_dear(self._expressions)
        if dear is not None:
            raise ExpressionError(dear)
        codes = {name: e.code for name, e in self._expressions.items()}
        share = MAX_STEPS // max(1, sum(code.varies for code in codes.values()))
        self._steps = {name: share if code.varies else MAX_STEPS for name, code in codes.items()}
        self._signals = [(name, code.run, self._steps[name]) for name, code in codes.items()]
        self._slots = 1 + max((e.slots for e in self._expressions.values()), default=0)
        paths = {path for e in self._expressions.values() for path in e.paths}
        self.fields = None if () in paths else frozenset(".".join(path) for path in paths)

    def __call__(self, message: object) -> Projected:
        """The signals of a message by name, and the names of those that failed."""
        fields = message if type(message) is dict or isinstance(message, Mapping) else _NO_FIELDS
        return self._project(fields, [0] * self._slots, 1)

    def rows(self, message: object) -> Sequence[Projected]:  # noqa: ARG002
        """The same of each element of the message, empty where it stands for itself."""
        return ()

    def _project(self, fields: Mapping[str, Any], frame: list[Any], rows: int) -> Projected:
        values: dict[str, Scalar] = {}
        failed: list[str] = []
        for name, run, steps in self._signals:
            frame[0] = steps // rows
            try:
                value = run(fields, frame)
            except Absent:
                continue
            except Exception:  # noqa: BLE001 no fault of an expression's evaluation ends a session
                failed.append(name)
            else:
                if is_signal(value):
                    values[name] = value
                elif value is not None:
                    failed.append(name)
        return values, frozenset(failed) if failed else _NONE

    def reasons(self, message: object) -> dict[str, str]:
        """Why each signal failed that did, in a few words. Computed anew: it is for people, and not for each event."""
        fields = message if isinstance(message, Mapping) else _NO_FIELDS
        _, failed = self(message)
        return {name: reason(self._expressions[name], fields, self._steps[name]) for name in sorted(failed)}


class RowProjection(Projection):
    """Computes the signals of a stream of which each element of a list is a step of its own, within the same bound."""

    def __init__(self, signals: Mapping[str, str], each: str) -> None:
        """Compile the expressions; `each` gives the list. Raises `ExpressionError`."""
        self._each = parse_expression(each)
        super().__init__(signals, self._each)

    def __call__(self, message: object) -> Projected:
        """What a message without rows has: no signals, or failed ones where it can't be said what its rows are."""
        fields = message if isinstance(message, Mapping) else _NO_FIELDS
        return {}, frozenset(self._expressions) if isinstance(self._elements(fields), str) else _NONE

    def rows(self, message: object) -> Sequence[Projected]:
        """What each element has, in order."""
        fields = message if isinstance(message, Mapping) else _NO_FIELDS
        found = self._elements(fields)
        if isinstance(found, str):
            return ()
        blank = [None] * (self._slots - 3)
        return [self._project(fields, [0, item, i, *blank], len(found)) for i, item in enumerate(found)]

    def reasons(self, message: object) -> dict[str, str]:
        """Why each signal failed that did, at the first row where it did, in a few words."""
        fields = message if isinstance(message, Mapping) else _NO_FIELDS
        found = self._elements(fields)
        if isinstance(found, str):
            return dict.fromkeys(sorted(self._expressions), found)
        first: dict[str, int] = {}
        for i, (_, failed) in enumerate(self.rows(message)):
            first = dict.fromkeys(failed, i) | first
        return {
            name: f"row {i}: {reason(self._expressions[name], fields, self._steps[name] // len(found), (found[i], i))}"
            for name, i in sorted(first.items())
        }

    def _elements(self, fields: Mapping[str, Any]) -> list[Any] | str:
        """The elements of a message, or why there are none, where there may be some."""
        each = self._each
        try:
            found = each.code.run(fields, each.frame(MAX_STEPS))
        except Absent:
            lacking = absent_at_an_element(each, fields, MAX_STEPS)
            return [] if lacking is None else f"`each`: {lacking}"
        except Exception:  # noqa: BLE001 no fault of an expression's evaluation ends a session
            return reason(each, fields, MAX_STEPS)
        if found is None:
            return []
        if type(found) is not list:
            return f"`each` is {told(found)}, and rows are the elements of a list"
        if len(found) > MAX_ROWS:
            return f"`each` has {len(found):,} elements, and a message may have {MAX_ROWS} rows"
        return found


class DefaultProjection:
    """Takes the signals of a stream that declares none: its top-level scalar fields of some names."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self.fields: frozenset[str] | None = frozenset(self._names)

    def rows(self, message: object) -> Sequence[Projected]:  # noqa: ARG002
        """None: each message stands for itself."""
        return ()

    def __call__(self, message: object) -> Projected:
        """The signals of a message by name, and the names of those that failed."""
        values: dict[str, Scalar] = {}
        failed: list[str] = []
        if isinstance(message, Mapping):
            for name in self._names:
                value: Any = message.get(name)
                if is_signal(value):
                    values[name] = value
                elif value is not None and not isinstance(value, Mapping | list):
                    failed.append(name)
        return values, frozenset(failed)

    def reasons(self, message: object) -> dict[str, str]:
        """Why each signal failed that did, in a few words."""
        _, failed = self(message)
        found = message if isinstance(message, Mapping) else _NO_FIELDS
        return {name: f"msg.{name} is {no_signal(found[name])}" for name in sorted(failed)}


def is_signal(value: object) -> bool:
    """Whether a value may be a signal: a string, a boolean, a 64-bit integer or a finite number."""
    kind = type(value)
    if kind is str:
        return value not in _NOT_FINITE
    if kind is float:
        return math.isfinite(value)  # type: ignore[arg-type]
    return kind is bool or (kind is int and value in _INTEGERS)
