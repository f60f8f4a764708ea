"""Messages to signals: what formulas see of an event.

A signal is a string, a boolean or a finite number. A field that is missing or null makes its signal absent; an
expression that fails, or a value that is none of those, makes it `failed`, and whatever reads it unknown.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

import cel

from oracle_server.core.errors import ExpressionError
from oracle_server.core.expressions import Expression, Path, check_size, parse_expression, prune, read
from oracle_server.core.formula.tree import Scalar
from oracle_server.core.plain import Declined, plain

_NOT_FINITE = frozenset({"NaN", "Infinity", "-Infinity"})
_INTEGERS = range(-(2**63), 2**64)
_NO_FIELDS: Mapping[str, Any] = {}
_NONE: frozenset[str] = frozenset()
_Projected = tuple[dict[str, Scalar], frozenset[str]]


class Projection:
    """Computes the signals of one stream from its messages."""

    def __init__(self, signals: Mapping[str, str]) -> None:
        """Compile `signals`, expressions by name. Raises `ExpressionError`."""
        parsed = {name: parse_expression(text) for name, text in signals.items()}
        self._signals = [(name, plain(e.text), e) for name, e in parsed.items()]
        paths = {path for e in parsed.values() for path in e.paths}
        self.fields = None if () in paths else frozenset(".".join(path) for path in paths)

    def __call__(self, message: object) -> _Projected:
        """The signals of a message by name, and the names of those that failed."""
        values: dict[str, Scalar] = {}
        failed: list[str] = []
        programs = []
        fields = message if isinstance(message, Mapping) else _NO_FIELDS
        for name, evaluate, expression in self._signals:
            if evaluate is not None:
                try:
                    _keep(name, evaluate(fields), values, failed)
                except Declined:
                    pass
                else:
                    continue
            programs.append((name, expression))
        if programs:
            _evaluate(programs, fields, values, failed)
        return values, frozenset(failed) if failed else _NONE


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
                value = message.get(name)
                if not isinstance(value, Mapping | list):
                    _keep(name, value, values, failed)
        return values, frozenset(failed)


def _evaluate(
    programs: list[tuple[str, Expression]], message: Mapping[str, Any], values: dict[str, Scalar], failed: list[str]
) -> None:
    """Run expressions over one message. Each message gets a fresh context, since an old one keeps the one before."""
    fit = []
    for name, expression in programs:
        try:
            check_size(message, expression)
        except ExpressionError:
            failed.append(name)
        else:
            fit.append((name, expression))
    try:
        context = cel.Context()
        context.add_variable("msg", prune(message, tuple(e for _, e in fit)))
    except Exception:  # noqa: BLE001 -- whatever the library makes of a message, the signals failed
        failed.extend(name for name, _ in fit)
        return
    for name, expression in fit:
        try:
            value = expression.program.execute(context)
        except Exception:  # noqa: BLE001 -- the library raises a dozen types
            if not any(_missing(message, path) for path in expression.paths):
                failed.append(name)
        else:
            _keep(name, value, values, failed)


def _keep(name: str, value: Any, values: dict[str, Scalar], failed: list[str]) -> None:
    if value is None:
        return
    if is_signal(value):
        values[name] = value
    else:
        failed.append(name)


def is_signal(value: object) -> bool:
    """Whether a value may be a signal: a string, a boolean, a 64-bit integer or a finite number."""
    kind = type(value)
    if kind is str:
        return value not in _NOT_FINITE
    if kind is float:
        return math.isfinite(value)  # type: ignore[arg-type]
    return kind is bool or (kind is int and value in _INTEGERS)


def _missing(message: object, path: Path) -> bool:
    return bool(path) and read(message, path) is None
