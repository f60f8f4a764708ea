"""Messages to signals: what formulas see of an event.

A signal is a string, a boolean or a finite number. A field that is missing or null makes its signal absent; an
expression that fails, or a value that is none of those, makes it `failed`, and whatever reads it unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import (
    MAX_STEPS,
    WANTED,
    Absent,
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
_Projected = tuple[dict[str, Scalar], frozenset[str]]


class Projection:
    """Computes the signals of one stream from its messages, within a bound on what an event may cost."""

    def __init__(self, signals: Mapping[str, str]) -> None:
        """Compile `signals`, expressions by name. Raises `ExpressionError`."""
        self._expressions = {name: parse_expression(text) for name, text in signals.items()}
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

    def __call__(self, message: object) -> _Projected:
        """The signals of a message by name, and the names of those that failed."""
        values: dict[str, Scalar] = {}
        failed: list[str] = []
        fields = message if type(message) is dict or isinstance(message, Mapping) else _NO_FIELDS
        frame: list[Any] = [0] * self._slots
        for name, run, steps in self._signals:
            frame[0] = steps
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


class DefaultProjection:
    """Takes the signals of a stream that declares none: its top-level scalar fields of some names."""

    def __init__(self, names: Iterable[str]) -> None:
        self._names = tuple(names)
        self.fields: frozenset[str] | None = frozenset(self._names)

    def __call__(self, message: object) -> _Projected:
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
        return {name: f"msg.{name} is {told(found[name])}, {WANTED}" for name in sorted(failed)}


def is_signal(value: object) -> bool:
    """Whether a value may be a signal: a string, a boolean, a 64-bit integer or a finite number."""
    kind = type(value)
    if kind is str:
        return value not in _NOT_FINITE
    if kind is float:
        return math.isfinite(value)  # type: ignore[arg-type]
    return kind is bool or (kind is int and value in _INTEGERS)
