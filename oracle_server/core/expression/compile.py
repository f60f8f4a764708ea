"""Tree to closures: each is called with the message and the frame, and returns the value of its part."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from oracle_server.core.expression import cost, tree
from oracle_server.core.expression.calls import call
from oracle_server.core.expression.comparing import compare
from oracle_server.core.expression.cost import Frame
from oracle_server.core.expression.fields import alone, element, field, has_element, has_field, has_path, path
from oracle_server.core.expression.functions import NUMBERS
from oracle_server.core.expression.joining import choice, joined, negation
from oracle_server.core.expression.loops import Run, loop
from oracle_server.core.expression.stops import Stopped
from oracle_server.core.expression.tree import Node
from oracle_server.core.expression.values import ARITHMETIC, is_number, minus

_CALLS = {"double": cost.CONVERSION, "int": cost.CONVERSION, "string": cost.CONVERSION, "uint": cost.CONVERSION,
          "matches": cost.PATTERN}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Code:
    """A part ready to run: the steps that it takes whatever the message is, and whether it may take more."""

    run: Run
    steps: int
    varies: bool = False


def compile_tree(node: Node, variables: Sequence[str] = (), *, traced: bool = False) -> tuple[Code, int]:
    """The code of an expression, and how many variables its frame has, the given ones first.

    `traced` code says which part has no value.
    """
    if isinstance(node, tree.Path) and len(node.names) == 1:
        return Code(alone(node.names[0]), cost.PART), len(variables)
    compiler = _Compiler(variables, traced=traced)
    return compiler.code(node), compiler.slots


class _Compiler:
    def __init__(self, variables: Sequence[str], *, traced: bool) -> None:
        self.slots = len(variables)
        self._traced = traced
        self._variables = list(variables)
        self._makers: dict[type, Callable[[Any], Code]] = {
            tree.Literal: self._literal,
            tree.Path: lambda node: Code(path(node.names), len(node.names)),
            tree.Variable: self._variable,
            tree.Field: self._field,
            tree.Index: self._index,
            tree.Unary: self._unary,
            tree.Chain: self._chain,
            tree.Compare: self._compare,
            tree.Joined: self._joined,
            tree.Choice: self._choice,
            tree.Call: self._call,
            tree.Has: self._has,
            tree.Loop: self._loop,
            tree.ListOf: self._list,
            tree.MapOf: self._map,
        }

    def code(self, node: Node) -> Code:
        made = self._makers[type(node)](node)
        return Code(_traced(node, made.run), made.steps, made.varies) if self._traced else made

    def _literal(self, node: tree.Literal) -> Code:
        value = node.value
        return Code(lambda _message, _frame: value, 0)

    def _variable(self, node: tree.Variable) -> Code:
        slot = len(self._variables) - self._variables[::-1].index(node.name)
        return Code(lambda _message, frame: frame[slot], cost.PART)

    def _field(self, node: tree.Field) -> Code:
        of = self.code(node.of)
        return _over(field(of.run, node.name), cost.PART, [of])

    def _index(self, node: tree.Index) -> Code:
        of, index = self.code(node.of), self.code(node.index)
        varies = not isinstance(node.index, tree.Literal)
        return _over(element(of.run, index.run), cost.ARITHMETIC, [of, index], varies=varies)

    def _unary(self, node: tree.Unary) -> Code:
        of = self.code(node.of)
        inner = of.run
        run: Run = negation(inner) if node.mark == "!" else lambda message, frame: minus(inner(message, frame))
        return _over(run, cost.PART, [of])

    def _chain(self, node: tree.Chain) -> Code:
        first = self.code(node.first)
        rest = [(ARITHMETIC[mark], self.code(operand)) for mark, operand in node.rest]
        codes = [first, *(code for _, code in rest)]
        numbers = _makes_number(node.first) or _makes_number(node.rest[0][1])
        varies = not numbers and any(mark == "+" for mark, _ in node.rest)
        run = _chain(first.run, [(work, code.run) for work, code in rest])
        return _over(run, cost.ARITHMETIC * len(rest), codes, varies=varies)

    def _compare(self, node: tree.Compare) -> Code:
        left, right = self.code(node.left), self.code(node.right)
        run, varies = compare(node, left.run, right.run)
        return _over(run, cost.PART, [left, right], varies=varies)

    def _joined(self, node: tree.Joined) -> Code:
        parts = [self.code(part) for part in node.parts]
        return _over(joined(node.mark, [part.run for part in parts]), cost.PART, parts)

    def _choice(self, node: tree.Choice) -> Code:
        cases = [(self.code(test), self.code(value)) for test, value in node.cases]
        otherwise = self.code(node.otherwise)
        run = choice([(test.run, value.run) for test, value in cases], otherwise.run)
        return _over(run, cost.PART, [*(code for case in cases for code in case), otherwise])

    def _call(self, node: tree.Call) -> Code:
        arguments = [self.code(argument) for argument in node.arguments]
        run, varies = call(node, [argument.run for argument in arguments])
        return _over(run, _CALLS.get(node.name, cost.CALL), arguments, varies=varies)

    def _has(self, node: tree.Has) -> Code:
        match node.of:
            case tree.Path(names=names):
                return Code(has_path(names), len(names))
            case tree.Field(of=of, name=name):
                whole = self.code(of)
                return _over(has_field(whole.run, name), cost.PART, [whole])
            case tree.Index(of=of, index=at):
                whole, index = self.code(of), self.code(at)
                return _over(has_element(whole.run, index.run), cost.ARITHMETIC, [whole, index], varies=True)

    def _loop(self, node: tree.Loop) -> Code:
        of = self.code(node.of)
        self._variables.append(node.variable)
        slot = len(self._variables)
        self.slots = max(self.slots, slot)
        body = self.code(node.body)
        when = self.code(node.when) if node.when is not None else None
        self._variables.pop()
        steps = body.steps + (when.steps if when is not None else 0)
        run = loop(node.kind, of.run, slot, body.run, when.run if when is not None else None, steps)
        return _over(run, cost.PART, [of], varies=True)

    def _list(self, node: tree.ListOf) -> Code:
        items = [self.code(item) for item in node.items]
        runs = [item.run for item in items]
        return _over(lambda message, frame: [run(message, frame) for run in runs], cost.ARITHMETIC + len(items), items)

    def _map(self, node: tree.MapOf) -> Code:
        values = [self.code(value) for value in node.values]
        runs = [(key, value.run) for key, value in zip(node.keys, values, strict=True)]
        return _over(
            lambda message, frame: {k: run(message, frame) for k, run in runs}, cost.ARITHMETIC + len(values), values
        )


def _makes_number(node: Node) -> bool:
    """Whether the value of a part is a number, where it has one: what is added to it takes no more than a step."""
    if isinstance(node, tree.Literal):
        return is_number(node.value)
    return isinstance(node, tree.Call) and node.name in NUMBERS


def _over(run: Run, steps: int, parts: list[Code], *, varies: bool = False) -> Code:
    """Code over others: its steps and theirs."""
    return Code(run, steps + sum(part.steps for part in parts), varies or any(part.varies for part in parts))


def _chain(first: Run, rest: list[tuple[Callable[[Any, Any, Frame], Any], Run]]) -> Run:
    if len(rest) == 1:
        ((work, other),) = rest
        return lambda message, frame: work(first(message, frame), other(message, frame), frame)

    def run(message: Mapping[str, Any], frame: Frame) -> Any:
        value = first(message, frame)
        for work, operand in rest:
            value = work(value, operand(message, frame), frame)
        return value

    return run


def _traced(node: Node, run: Run) -> Run:
    def traced(message: Mapping[str, Any], frame: Frame) -> Any:
        try:
            return run(message, frame)
        except Stopped as stop:
            if stop.node is None:
                stop.node = node
            raise

    return traced
