"""The numbers that formulas compare the signals of streams with: the lines to draw where the signals are plotted."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Atom
from oracle_server.core.spec import Spec

MOST = 10_000
"""Of a spec: where each formula may be of each stream there would be hundreds of thousands, for a plot of a few."""
_NAMES = ("topic", "service", "ros_action")


class Threshold(NamedTuple):
    """A property compares a signal of a stream with a number."""

    stream: StreamKey
    signal: str
    property: str
    op: str
    value: float


def thresholds(spec: Spec) -> list[Threshold]:
    """The first `MOST` of a spec, each once, in the order of its properties."""
    found: dict[Threshold, None] = {}
    for each in (each for p in spec.properties for atom in p.atoms for each in _of(spec, p.id, atom)):
        found[each] = None
        if len(found) == MOST:
            break
    return [*found]


def _of(spec: Spec, id_: str, atom: Atom) -> Iterator[Threshold]:
    named = [c.value for c in atom.constraints if c.key in _NAMES and c.op == "=="]
    for constraint in atom.constraints:
        if isinstance(constraint.value, bool) or not isinstance(constraint.value, int | float):
            continue
        for stream in spec.streams:
            own = stream.signals is None or constraint.key in stream.signals
            if own and (not named or stream.name in named):
                yield Threshold(stream.key, constraint.key, id_, constraint.op, constraint.value)
