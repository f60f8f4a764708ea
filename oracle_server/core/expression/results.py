"""What an expression gives where it gives a value: its choices one by one; and whether it may be absent."""

from __future__ import annotations

from collections.abc import Iterator

from oracle_server.core.expression import tree
from oracle_server.core.expression.check import known
from oracle_server.core.expression.expression import Expression
from oracle_server.core.expression.spans import Span, reads
from oracle_server.core.expression.tree import Literal, Node
from oracle_server.core.shapes import Many, Record, Shape, Value

_NEVER_ABSENT = (
    tree.Variable | tree.Unary | tree.Chain | tree.Compare | tree.Joined | tree.Choice | tree.Call | tree.Loop
    | tree.ListOf
)  # fmt: skip
"""The parts that have a value, or fail, where all parts under them do."""


def results(expression: Expression, shape: Shape | None) -> Iterator[Literal | Span | Value | None]:
    """What each choice gives over messages of a shape: what is written out, numbers, a kind, or None for anything."""
    waiting = [expression.tree]
    while waiting:
        node = waiting.pop()
        if isinstance(node, tree.Choice):
            waiting += [node.otherwise, *(value for _, value in reversed(node.cases))]
        elif isinstance(node, Literal):
            yield node
        else:
            found = known(expression, node, shape)
            span = found.span if reads(node) else None  # of what reads nothing that is told
            yield span or (found.static if isinstance(found.static, Value) else None)


def is_always_there(expression: Expression, shape: Shape) -> bool:
    """Whether an expression has a value, or fails, at every message that has all fields of a shape.

    One of rows has none where there is no row.
    """
    return expression.each is None and all(_is_there(node, shape) for node in tree.walk(expression.tree))


def certain(node: Node) -> Iterator[str]:
    """First names of fields without any of which the value is absent, whatever the others are."""
    match node:
        case tree.Path(names=(name, *_)):
            yield name
        case tree.Joined() | tree.Has() | tree.MapOf():
            return
        case tree.Choice(cases=((test, _), *_)):
            yield from certain(test)
        case tree.Loop(of=of):
            yield from certain(of)
        case _:
            for each in tree.children(node):
                yield from certain(each)


def _is_there(node: Node, shape: Shape) -> bool:
    match node:
        case Literal(value=value):
            return value is not None
        case tree.Path(names=names):
            return _at(shape, names) is not None
        case tree.Index(of=tree.Path(names=names)):
            return isinstance(_at(shape, names), Many)
        case _:
            return isinstance(node, _NEVER_ABSENT)


def _at(shape: Shape, names: tuple[str, ...]) -> Shape | None:
    found: Shape | None = shape
    for name in names:
        found = found.fields.get(name) if isinstance(found, Record) else None
    return found
