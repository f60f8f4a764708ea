"""The values that derived signals can have."""

from __future__ import annotations

from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import result_kind
from oracle_server.core.ranges import ANYTHING, BOOLEAN, NUMBER, TEXT, Range, range_of
from oracle_server.core.spec import Spec

_KINDS = {"real": NUMBER, "whole": NUMBER, "text": TEXT, "bool": BOOLEAN}


def derived_ranges(spec: Spec) -> dict[str, Range]:
    """The values of each derived signal, and of the signals that all streams declare; expressions may be unsound."""
    found: dict[str, Range] = {}
    if all(stream.signals is not None for stream in spec.streams):
        for stream in spec.streams:
            for name, text in (stream.signals or {}).items():
                found[name] = found.get(name, Range()) | range_of(text, each=stream.each)
    for definition in spec.derive:
        found[definition.name] = _range(definition, found)
    return found


def _range(definition: Definition, known: dict[str, Range]) -> Range:
    if definition.op == "expression":
        try:
            kind = result_kind(definition.expression, None)
        except ExpressionError:  # found elsewhere
            return ANYTHING
        return ANYTHING if kind is None else _KINDS.get(kind, ANYTHING)
    if definition.table is not None:
        return Range(values=tuple(dict.fromkeys(value for value in definition.table.values if value is not None)))
    if definition.op in ("last", "previous"):
        return known.get(definition.of, ANYTHING)
    return NUMBER
