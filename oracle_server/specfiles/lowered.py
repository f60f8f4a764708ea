"""The formulas of a spec as they are judged: all names written out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TypedDict

from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Time
from oracle_server.core.spec import Property


class Lowered(TypedDict):
    """A property's formula; `time` is what its bounds count."""

    property: str
    time: Time
    formula: str


def lowered(properties: Iterable[Property]) -> Iterator[Lowered]:
    """Each property's formula, of those that are formulas of ours."""
    for prop in properties:
        if not prop.external and not prop.numeric:
            yield {"property": prop.id, "time": prop.time, "formula": render(prop.formula, prop.time)}
