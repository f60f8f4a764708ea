"""What is Boolean between nodes, as expressions of them, and what follows from how these are made."""

from __future__ import annotations

from collections.abc import Iterable
from functools import reduce
from typing import Any

from oracle_server.engines.native.keys import Variables
from oracle_server.engines.native.nodes import Node

Expression = Any
"""A node, `("not", node)`, or `("and" | "or", left, right)`: negations stand at nodes only."""


def negated(expression: Expression) -> Expression:
    """The negation, moved down to the nodes."""
    if not isinstance(expression, tuple):
        return ("not", expression)
    if expression[0] == "not":
        return expression[1]
    word = "or" if expression[0] == "and" else "and"
    return (word, negated(expression[1]), negated(expression[2]))


def nodes_of(expression: Expression) -> list[Node]:
    """The nodes of an expression, from left to right."""
    if not isinstance(expression, tuple):
        return [expression]
    return [node for part in expression[1:] for node in nodes_of(part)]


def variables_of(*expressions: Expression) -> Variables:
    """The variables that expressions depend on, outermost first."""
    return tuple(sorted({v for e in expressions for node in nodes_of(e) for v in node.variables}))


def conjuncts(expression: Expression) -> list[Expression]:
    """The parts of an expression that all must hold where it does, from left to right."""
    if isinstance(expression, tuple) and expression[0] == "and":
        return conjuncts(expression[1]) + conjuncts(expression[2])
    return [expression]


def all_of(parts: Iterable[Expression]) -> Expression:
    """The conjunction of one expression or more."""
    return reduce(lambda left, right: ("and", left, right), parts)


def bound(expression: Expression) -> frozenset[int]:
    """The variables of which some node tells the values wherever an expression holds: finitely many, none fresh."""
    if not isinstance(expression, tuple):
        return frozenset(expression.binds)
    if expression[0] == "not":
        return frozenset()
    left, right = bound(expression[1]), bound(expression[2])
    return left | right if expression[0] == "and" else left & right


def is_finite(expression: Expression) -> bool:
    """Whether an expression has variables, and holds at finitely many keys, none with a fresh value."""
    variables = variables_of(expression)
    return bool(variables) and bound(expression).issuperset(variables)


def is_lasting(expression: Expression) -> bool:
    """Whether an expression holds from then on at a key where it once does, as far as its nodes tell."""
    if not isinstance(expression, tuple):
        return bool(expression.lasting)
    return expression[0] != "not" and all(is_lasting(side) for side in expression[1:])


def unrelated(expression: Expression) -> list[Expression]:
    """Conjunctions without a variable in common that together are an expression; the first has what has none."""
    groups: list[tuple[set[int], list[Expression]]] = []
    plain: list[Expression] = []
    for part in conjuncts(expression):
        variables, parts = set(variables_of(part)), [part]
        if not variables:
            plain.append(part)
            continue
        for group in [group for group in groups if group[0] & variables]:
            groups.remove(group)
            variables, parts = variables | group[0], group[1] + parts
        groups.append((variables, parts))
    found = [all_of(parts) for _, parts in groups]
    return [all_of([*plain, found[0]]), *found[1:]] if found else [expression]
