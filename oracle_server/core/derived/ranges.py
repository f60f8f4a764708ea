"""The values that derived signals can have."""

from __future__ import annotations

from collections.abc import Mapping

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import result_kind
from oracle_server.core.expression.tree import Path
from oracle_server.core.ranges import ANYTHING, BOOLEAN, NUMBER, POSITIVE, TEXT, Range, range_of
from oracle_server.core.spec import Spec

_MANY = 2**63
JUST_NOW = Range(values=(0,))
"""What an age is at a step at which its own formula holds."""
_KINDS = {"real": NUMBER, "whole": NUMBER, "text": TEXT, "bool": BOOLEAN}


def derived_ranges(spec: Spec, signals: Mapping[str, Range] | None = None) -> dict[str, Range]:
    """The values of each derived signal, and of the signals that all streams declare; expressions may be unsound.

    `signals` are the values of all that messages have, where that is known better than their expressions tell.
    """
    found = dict(signals or {})
    if signals is None and all(stream.signals is not None for stream in spec.streams):
        for stream in spec.streams:
            for name, text in (stream.signals or {}).items():
                found[name] = found.get(name, Range()) | range_of(text, each=stream.each)
    for definition in spec.derive:
        found[definition.name] = _range(definition, found)
    return found


def ranges_now(spec: Spec) -> dict[str, tuple[Definition, Range]]:
    """The ages and counts of a spec, each with its values where its own formula holds."""
    counts = {d.name: (d, Range(whole=(1, _most(d)))) for d in spec.derive if d.op == "count"}
    return counts | {d.name: (d, JUST_NOW) for d in spec.derive if d.op == "age"}


def _range(definition: Definition, known: Mapping[str, Range]) -> Range:
    if definition.op == "expression":
        return _computed(definition, known)
    if definition.table is not None:
        return Range(values=tuple(dict.fromkeys(value for value in definition.table.values if value is not None)))
    if definition.op in ("last", "previous"):
        return known.get(definition.of, ANYTHING)
    if definition.op in ("min", "max"):
        return known.get(definition.of, ANYTHING).numbers
    if definition.op == "count":
        return Range(whole=(0, _most(definition)))
    return POSITIVE if definition.op in ("rate", "age") else NUMBER


def _most(definition: Definition) -> int:
    """The most that a count can be."""
    return definition.over if definition.counted and definition.over is not None else _MANY


def _computed(definition: Definition, known: Mapping[str, Range]) -> Range:
    try:
        expression = definition.expression
        kind = result_kind(expression, None)
    except ExpressionError:  # found elsewhere
        return ANYTHING
    if isinstance(expression.tree, Path) and len(expression.tree.names) == 1:
        return known.get(expression.tree.names[0], ANYTHING)
    return ANYTHING if kind is None else _KINDS.get(kind, ANYTHING)
