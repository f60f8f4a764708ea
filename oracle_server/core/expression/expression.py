"""An expression: its text, its tree and its code, and the fields of `msg` that it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from oracle_server.core.expression import tree
from oracle_server.core.expression.compile import Code, compile_tree
from oracle_server.core.expression.cost import MAX_KNOWN_STEPS, MAX_ROWS, MAX_STEPS, Frame
from oracle_server.core.expression.parse import parse
from oracle_server.core.expression.tree import Node

FieldPath = tuple[str, ...]
ROW = ("item", "index")
"""What stands for a row's element, and for its place from 0."""


@dataclass(frozen=True)
class Expression:
    """A checked expression; `slots` is how many variables its frame has beside the steps that are left."""

    text: str
    tree: Node = field(repr=False)
    code: Code = field(repr=False)
    slots: int
    each: Expression | None = None
    """The list of which `item` is an element, and `index` its place; None where it has no rows."""

    @cached_property
    def paths(self) -> tuple[FieldPath, ...]:
        """The fields of `msg` that are read, each once, the empty path being the whole message."""
        found = (node.names for node in tree.walk(self.tree) if isinstance(node, tree.Path))
        of_rows = () if self.each is None else self.each.paths
        return tuple(dict.fromkeys((*of_rows, *(_dotted(names) for names in found))))

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Of one over signals: those that are read, each once."""
        return tuple(dict.fromkeys(path[0] for path in self.paths if path))

    @cached_property
    def traced(self) -> Code:
        """The same code, whose stops say which part of the expression has no value."""
        return compile_tree(self.tree, self.variables, traced=True)[0]

    @property
    def variables(self) -> tuple[str, ...]:
        """The names that stand for values beside `msg`, in the order of the frame."""
        return () if self.each is None else ROW

    @property
    def patterns(self) -> int:
        """How many patterns there are in it."""
        return sum(isinstance(node, tree.Call) and node.name == "matches" for node in tree.walk(self.tree))

    @property
    def unwritten(self) -> bool:
        """Whether a part of it is still to be written, as `todo()` says."""
        return any(isinstance(node, tree.Call) and node.name == "todo" for node in tree.walk(self.tree))

    @property
    def is_field(self) -> bool:
        """Whether it is a field of the message as it stands there, and nothing is chosen or computed."""
        return isinstance(self.tree, tree.Path)

    @property
    def is_of_row(self) -> bool:
        """Whether it reads the row's element, or its place."""
        return any(isinstance(node, tree.Variable) and node.name in self.variables for node in tree.walk(self.tree))

    def frame(self, steps: int, row: Sequence[object] = ()) -> Frame:
        """A frame for one evaluation, which may take so many steps; `row` is the element and its place."""
        return [steps, *row, *[None] * (self.slots - len(row))]


def parse_expression(text: str, *, signals: bool = False, each: Expression | None = None) -> Expression:
    """Read and check an expression, over `msg` or over `signals`, which stand in it by their names.

    With `each`, a list, it is over `item` and `index` too. Raises `ExpressionError`, with the line and column in the
    text.
    """
    variables = () if each is None else ROW
    node = parse(text, variables, signals=signals)
    code, slots = compile_tree(node, variables)
    return Expression(text, node, code, slots, each)


def too_dear(expressions: Mapping[str, Expression]) -> str | None:
    """Why one stream can't have all of these signals, None where it can."""
    steps = sum(expression.code.steps for expression in expressions.values())
    if any(expression.each is not None for expression in expressions.values()):
        most, when = MAX_STEPS // MAX_ROWS, "each row"
    else:
        most, when = MAX_KNOWN_STEPS, "every message"
    if steps <= most:
        return None
    return f"the signals take {steps} steps at {when}, and may take {most}; leave some out"


def read(message: object, path: FieldPath) -> Any:
    """The value at a path of a message, None where it is missing."""
    for name in path:
        if not isinstance(message, Mapping):
            return None
        message = message.get(name)
    return message


def _dotted(names: FieldPath) -> FieldPath:
    """The path as far as dots can be put between its names."""
    for i, name in enumerate(names):
        if not name or "." in name:
            return names[:i]
    return names
