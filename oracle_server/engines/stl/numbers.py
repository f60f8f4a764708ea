"""Arithmetic on signals, computed before rtamt gets a sample.

What divides by zero must not reach a monitor half: it has taken in a sample, or has not.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rtamt.syntax.node.arithmetic.abs import Abs
from rtamt.syntax.node.arithmetic.addition import Addition
from rtamt.syntax.node.arithmetic.division import Division
from rtamt.syntax.node.arithmetic.exp import Exp
from rtamt.syntax.node.arithmetic.multiplication import Multiplication
from rtamt.syntax.node.arithmetic.pow import Pow
from rtamt.syntax.node.arithmetic.sqrt import Sqrt
from rtamt.syntax.node.arithmetic.subtraction import Subtraction
from rtamt.syntax.node.ltl.constant import Constant
from rtamt.syntax.node.ltl.predicate import Predicate
from rtamt.syntax.node.ltl.variable import Variable

from oracle_server.core.errors import FormulaError

Number = Callable[[Mapping[str, float]], float]
"""A number from the signals by name. Raises ValueError or ArithmeticError where there is none."""

_FUNCTIONS: dict[type, Callable[..., float]] = {
    Abs: abs,
    Sqrt: math.sqrt,
    Exp: math.exp,
    Pow: math.pow,
    Addition: operator.add,
    Subtraction: operator.sub,
    Multiplication: operator.mul,
    Division: operator.truediv,
}


def nodes(root: Any) -> Iterator[Any]:
    """Every node of rtamt's tree, itself first."""
    todo = [root]
    while todo:
        node = todo.pop()
        yield node
        todo.extend(reversed(operands(node)))


def operands(node: Any) -> list[Any]:
    """The direct sub-formulas of a node, from left to right; some nodes list theirs twice."""
    return list({id(child): child for child in node.children}.values())


def take_out(root: Any) -> tuple[Any, dict[str, Number]]:
    """The tree with a variable in place of each arithmetic part, and these parts by the variables' names.

    Raises `FormulaError` where arithmetic is done on formulas.
    """
    numbers: dict[str, Number] = {}

    def replaced(node: Any) -> Any:
        if type(node) in _FUNCTIONS:
            name = f"#{len(numbers)}"
            numbers[name] = _number(node)
            return Variable(name, "")
        if isinstance(node, Predicate):
            for operand in operands(node):
                _number(operand)
        node.children = [replaced(operand) for operand in operands(node)]
        return node

    return replaced(root), numbers


def _number(node: Any) -> Number:
    if isinstance(node, Variable):
        return operator.itemgetter(node.var)
    if isinstance(node, Constant):
        if not math.isfinite(node.val):
            raise FormulaError("a number is too large")
        value = float(node.val)
        return lambda _: value
    function = _FUNCTIONS.get(type(node))
    if function is None:
        raise FormulaError("a number is expected here, and not a formula")
    parts = [_number(child) for child in operands(node)]

    def number(signals: Mapping[str, float]) -> float:
        value = function(*[part(signals) for part in parts])
        if not math.isfinite(value):
            raise ValueError("not finite")
        return value

    return number
