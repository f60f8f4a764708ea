"""Where an expression can hold, from what some of its variables are: candidates for another one."""

from __future__ import annotations

from collections.abc import Callable, Collection
from functools import partial

from oracle_server.engines.native.expressions import Expression
from oracle_server.engines.native.keys import Region, Variables
from oracle_server.engines.native.nodes import Node

Finder = Callable[[Region], Collection[str]]
"""The texts of one variable at which an expression can hold in a region; it may hold at fewer."""


def finder(expression: Expression, variables: Variables, place: int) -> Finder | None:
    """What finds candidates for a variable, None where no node tells its values wherever the expression holds."""
    if not isinstance(expression, tuple):
        if variables[place] not in expression.binds:
            return None
        places = [variables.index(v) for v in expression.variables]
        return partial(_of_node, expression, places, places.index(place))
    if expression[0] == "not":
        return None
    left, right = (finder(side, variables, place) for side in expression[1:])
    if expression[0] == "or":
        return None if left is None or right is None else partial(_of_either, left, right)
    return left or right if left is None or right is None else partial(_of_both, left, right)


def _of_node(node: Node, places: list[int], place: int, region: Region) -> Collection[str]:
    return node.spread([region[p] for p in places], place)


def _of_either(left: Finder, right: Finder, region: Region) -> Collection[str]:
    return {*left(region), *right(region)}


def _of_both(left: Finder, right: Finder, region: Region) -> Collection[str]:
    """Those of the side that has fewer; both have all."""
    found = left(region)
    if len(found) < 2:
        return found
    others = right(region)
    return found if len(found) <= len(others) else others
