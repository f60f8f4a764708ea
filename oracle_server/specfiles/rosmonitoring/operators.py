"""Python's operators over values: comparisons, arithmetic, and what is inside of what."""

from __future__ import annotations

import ast
import operator
import re
import sys
from collections.abc import Callable
from typing import Any

from oracle_server.core.shapes import Many, Record
from oracle_server.specfiles.rosmonitoring.cel import bare, field, inner, literal, negated, number, text_of
from oracle_server.specfiles.rosmonitoring.equality import FALSE, TRUE, equal, identical, inside
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Leaf,
    Raises,
    Term,
    UntranslatableError,
    Value,
    choice,
    each,
    leaves,
)

_ORDER: dict[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
}
_ARITHMETIC: dict[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.FloorDiv: ("//", operator.floordiv),
    ast.Mod: ("%", operator.mod),
    ast.Pow: ("**", operator.pow),
}
_MAX_CONSTANT = 4096
_LARGEST = repr(sys.float_info.max)


def pairs(left: Value, right: Value, work: Callable[[Leaf, Leaf], Value]) -> Value:
    """An operator over the leaves of two trees."""
    return each(left, lambda a: each(right, lambda b: work(a, b)))


def compare(left: Value, op: ast.cmpop, right: Value) -> Value:  # noqa: PLR0911 -- a case an operator
    """A comparison. Raises `UntranslatableError`."""
    match op:
        case ast.Eq():
            return pairs(left, right, equal)
        case ast.NotEq():
            return opposite(pairs(left, right, equal))
        case ast.In():
            return pairs(left, right, inside)
        case ast.NotIn():
            return opposite(pairs(left, right, inside))
        case ast.Is():
            return pairs(left, right, identical)
        case ast.IsNot():
            return opposite(pairs(left, right, identical))
    return pairs(left, right, lambda a, b: _ordered(a, op, b))


def opposite(value: Value) -> Value:
    """`not`, of a Boolean tree."""
    return choice(value, FALSE, TRUE) if not isinstance(value, Term) else negated(value)


def _ordered(left: Leaf, op: ast.cmpop, right: Leaf) -> Value:
    word, work = _ORDER[type(op)]
    match left, right:
        case Const(a), Const(b):
            try:
                return Const(work(a, b))
            except TypeError:
                return Raises("TypeError")
    if {_sort(left), _sort(right)} == {"number", "text"}:
        return Raises("TypeError")
    one, other = _operand(left), _operand(right)
    if one is None or other is None:
        return Raises("TypeError")
    return Term(f"{one} {word} {other}", "bool")


def _sort(leaf: Leaf) -> str | None:
    """Whether a value is a number or a text, None where that is not known."""
    match leaf:
        case Const(bool() | int() | float()) | Term(kind="bool" | "number"):
            return "number"
        case Const(str()) | Term(kind="text"):
            return "text"
    return None


def _operand(leaf: Leaf) -> str | None:
    """What is compared by size; None where Python can't."""
    match leaf:
        case Const(bool() as value):
            return literal(int(value))
        case Const(int() | float() | str() as value):
            return literal(value)
        case Const(None | list() | dict()) | Field(_, Record() | Many()):
            return None
        case Field(path):
            return field(path)
        case Term(_, "bool"):
            return f"({inner(leaf)} ? 1 : 0)"
        case Term():
            return inner(leaf)
    raise UntranslatableError


def arithmetic(left: Value, op: ast.operator, right: Value) -> Value:
    """An operator over numbers or texts. Raises `UntranslatableError`."""
    return pairs(left, right, lambda a, b: _arithmetic(a, op, b))


def grows(op: ast.operator, more: Value) -> bool:
    """Whether an operator as `+=` may change a list or dict in place."""
    if isinstance(op, ast.Add):
        return not all(_sort(leaf) == "number" for leaf in leaves(more))
    return isinstance(op, ast.Mult | ast.BitOr)


def _arithmetic(left: Leaf, op: ast.operator, right: Leaf) -> Value:  # noqa: PLR0911 -- a case a pair
    word, work = _ARITHMETIC.get(type(op), (None, operator.add))
    if word is None or (word == "//" and not (isinstance(left, Const) and isinstance(right, Const))):
        raise UntranslatableError
    match left, right:
        case Const(a), Const(b):
            return _known(word, work, a, b)
        case _ if {_sort(left), _sort(right)} == {"number", "text"} and word not in ("*", "%"):
            return Raises("TypeError")
        case (Const(str()) | Term(kind="text"), _) | (_, Const(str()) | Term(kind="text")):
            return Term(f"{text_of(left)} + {text_of(right)}", "text") if word == "+" else _untranslatable()
        case ((Field(_, None) | Term(kind="number")), Const(int() as base)) if word == "%" and 0 < base < 2**31:
            return _remainder(left, base)
        case _, Const(int() as power) if word == "**" and 2 <= power <= 4:
            return _power(left, power)
    if word in ("%", "**"):
        raise UntranslatableError
    if word == "/":
        return _quotient(left, right)
    if word in ("+", "-", "*") and _is_whole(left) and _is_whole(right):
        return Term(f"({_whole(left)} {word} {_whole(right)})", "number", tight=True, whole=True)
    return Term(f"({number(left)} {word} {number(right)})", "number", tight=True)


def _quotient(left: Leaf, right: Leaf) -> Value:
    """A division, which fails in Python where CEL's is infinite."""
    divisor = number(right)
    found = Term(f"({number(left)} / {divisor})", "number", tight=True)
    test = Const(right.value == 0) if isinstance(right, Const) else Term(f"{divisor} == 0.0", "bool")
    return choice(test, Raises("ZeroDivisionError"), found)


def _power(left: Leaf, power: int) -> Value:
    """A power, which fails in Python where that of a finite number is infinite."""
    if _is_whole(left):
        return Term(f"({' * '.join([_whole(left)] * power)})", "number", tight=True, whole=True)
    base = number(left)
    found = Term(f"({' * '.join([base] * power)})", "number", tight=True)
    test = Term(f"abs({bare(base)}) <= {_LARGEST} && abs{found.text} > {_LARGEST}", "bool")
    return choice(test, Raises("OverflowError"), found)


def _is_whole(leaf: Leaf) -> bool:
    """Whether a number is known to be whole, here as in Python."""
    if isinstance(leaf, Const):
        return isinstance(leaf.value, int) and not isinstance(leaf.value, bool)
    return isinstance(leaf, Term) and leaf.kind == "number" and leaf.whole is True


def _whole(leaf: Leaf) -> str:
    return literal(leaf.value) if isinstance(leaf, Const) else inner(leaf)  # type: ignore[arg-type]


def _remainder(left: Leaf, base: int) -> Value:
    if isinstance(left, Term) and not left.whole:
        raise UntranslatableError
    text = field(left.path) if isinstance(left, Field) else inner(left)  # type: ignore[arg-type]
    return Term(f"(({text} % {base} + {base}) % {base})", "number", tight=True, whole=True)


def _untranslatable() -> Value:
    raise UntranslatableError


def _known(word: str, work: Callable[[Any, Any], Any], a: Any, b: Any) -> Value:
    sizes = [len(v) if isinstance(v, str | list | tuple) else abs(v) if isinstance(v, int) else 0 for v in (a, b)]
    if word in ("*", "**", "%") and max(sizes) > _MAX_CONSTANT and any(not isinstance(v, int | float) for v in (a, b)):
        raise UntranslatableError
    if word == "%" and isinstance(a, str) and re.search(r"\d{4,}", a):
        raise UntranslatableError
    if word == "**" and (not isinstance(b, int | float) or abs(b) > 64 or sizes[0] > 2**32):
        raise UntranslatableError
    try:
        found = work(a, b)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError, KeyError) as error:
        return Raises(type(error).__name__)
    if isinstance(found, str | list | tuple) and len(found) > _MAX_CONSTANT:
        raise UntranslatableError
    return Const(found)
