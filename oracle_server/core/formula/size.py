"""How large a formula is, which is asked before anything walks through it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.tree import Formula, Use, children

MAX_DEPTH = 100
"""Deepest nesting of a formula; every walk over a tree stays far from Python's recursion limit."""
MAX_PARTS = 16_384
"""Most operators and atoms of a formula: as many as characters can be read."""


class Size(NamedTuple):
    """How deep a formula is nested, 0 for an atom, and how many parts it has: one that stands in it twice is two."""

    depth: int
    parts: int


def measured(formula: Formula, of_use: Callable[[Use], Size]) -> tuple[Size, int]:
    """The size of a formula with its names written out, and how many objects it is. Raises `FormulaError`."""
    sizes: dict[int, Size] = {}
    waiting: list[Formula | Use] = [formula]
    while waiting:
        node = waiting[-1]
        if isinstance(node, Use):
            sizes[id(waiting.pop())] = of_use(node)
            continue
        below = children(node)
        missing = [part for part in below if id(part) not in sizes]
        if missing:
            waiting += missing
            continue
        found = [sizes[id(part)] for part in below]
        depth = 1 + max((size.depth for size in found), default=-1)
        sizes[id(waiting.pop())] = Size(depth, 1 + sum(size.parts for size in found))
    whole = sizes[id(formula)]
    if whole.depth >= MAX_DEPTH:
        raise FormulaError(f"the formula is nested more than {MAX_DEPTH} deep")
    if whole.parts > MAX_PARTS:
        shown = f"{whole.parts:,}" if whole.parts < 10**9 else "more than a billion"
        raise FormulaError(f"the formula has {shown} parts once all is written out; at most {MAX_PARTS:,} are judged")
    return whole, len(sizes)
