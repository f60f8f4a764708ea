"""Expressions that read nothing of a message, and so have the same value at each one."""

from __future__ import annotations

import re

from oracle_server.core.expression import tree
from oracle_server.core.expression.expression import Expression
from oracle_server.core.expression.tree import Node

_READS = re.compile(r"msg\s*[.\[]")
"""How an expression that reads a message mostly begins."""


def idle(expression: Expression) -> str | None:
    """What is said of one that reads nothing, None of others, and where the value is as good as written out alone.

    A value by itself names the events of a stream, or says what all of them have, as does a number that is computed of
    numbers, `3.14 / 2`; what has none is told elsewhere.
    """
    parts = tree.walk(expression.tree)
    if any(_may_differ(part) for part in parts) or (len(parts) > 1 and all(_is_number(part) for part in parts)):
        return None
    first = parts[0]
    if not isinstance(first, tree.Literal):
        return f"`{expression.text}` reads nothing of the message, and is the same at each one"
    if isinstance(first.value, str) and _READS.match(first.value):
        return f"`{expression.text}` is a text, the same at each message; leave its quotes out for the field"
    return None


def _may_differ(part: Node) -> bool:
    """Whether a part reads the message, or has no value yet, or never."""
    if isinstance(part, tree.Call):
        return part.name in ("todo", "unknown")
    return isinstance(part, tree.Path | tree.Variable)


def _is_number(part: Node) -> bool:
    """Whether a part is a number, or arithmetic where its own parts are such."""
    match part:
        case tree.Literal(value):
            return isinstance(value, float | int) and not isinstance(value, bool)
        case tree.Unary(mark):
            return mark == "-"
    return isinstance(part, tree.Chain)
