"""How large a formula is once all of it is written out: parts that are there twice in a text count twice."""

from __future__ import annotations

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.tree import Formula, children, rebuilt

MAX_DEPTH = 100
"""Deepest nesting of a formula; every walk over a tree stays far from Python's recursion limit."""
MAX_PARTS = 16_384
"""Most operators and atoms of a formula: as many as characters can be read."""


def whole(formula: Formula) -> Formula:
    """The formula with each of its parts an object of its own. Raises `FormulaError` where it is too large."""
    depth, parts, objects = _measured(formula)
    if depth >= MAX_DEPTH:
        raise FormulaError(f"the formula is nested more than {MAX_DEPTH} deep")
    if parts > MAX_PARTS:
        raise FormulaError(f"the formula has {parts:,} parts once all is written out; at most {MAX_PARTS:,} are judged")
    return formula if parts == objects else _unshared(formula)


def _unshared(formula: Formula) -> Formula:
    return rebuilt(formula, _unshared)


def _measured(formula: Formula) -> tuple[int, int, int]:
    """How deep a formula is nested, 0 for an atom; how many parts it has; and how many objects these are."""
    sizes: dict[int, tuple[int, int]] = {}
    waiting = [formula]
    while waiting:
        node = waiting[-1]
        below = children(node)
        missing = [part for part in below if id(part) not in sizes]
        if missing:
            waiting += missing
            continue
        found = [sizes[id(part)] for part in below]
        sizes[id(node)] = 1 + max((depth for depth, _ in found), default=-1), 1 + sum(parts for _, parts in found)
        waiting.pop()
    return *sizes[id(formula)], len(sizes)
