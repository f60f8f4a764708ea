"""Python's operators over values: comparisons, arithmetic, and what is inside of what."""

from __future__ import annotations

import ast
import operator
import re
from collections.abc import Callable
from typing import Any

from oracle_server.core.signals import UNWRITTEN as STUB
from oracle_server.specfiles.rosmonitoring.cel import field, has, inner, literal, negated, number
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Items,
    Leaf,
    Message,
    Name,
    Raises,
    Term,
    UntranslatableError,
    Value,
    choice,
    each,
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
TRUE, FALSE = Const(True), Const(False)


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
            return pairs(left, right, _is)
        case ast.IsNot():
            return opposite(pairs(left, right, _is))
    return pairs(left, right, lambda a, b: _ordered(a, op, b))


def opposite(value: Value) -> Value:
    """`not`, of a Boolean tree."""
    return choice(value, FALSE, TRUE) if not isinstance(value, Term) else negated(value)


def equal(left: Leaf, right: Leaf) -> Value:  # noqa: C901, PLR0911 -- a case a pair
    """`==`, in which Python's 1 and True are equal and CEL's are not."""
    if isinstance(left, Const) and not isinstance(right, Const):
        left, right = right, left
    match left, right:
        case Const(a), Const(b):
            if isinstance(a, Name) or isinstance(b, Name):
                return Const(isinstance(a, str) and isinstance(b, str) and a.strip("/") == b.strip("/"))
            return Const(a == b)
        case Field(path), Const(value):
            return _field_is(field(path), value)
        case Term(_, "bool"), Const(bool() | int() | float() as value):
            return (left if value else negated(left)) if value in (0, 1) else FALSE
        case Term(_, "number"), Const(bool() | int() | float() as value):
            return Term(f"{inner(left)} == {literal(_plain(value))}", "bool")
        case Term(_, "text"), Const(str() as value):
            return Term(f"{inner(left)} == {literal(value)}", "bool")
        case Term(kind="bool" | "text"), Const(str() | None):
            return FALSE
        case Field(a), Field(b):
            one, other = field(a), field(b)
            return _where(f"({one} in [true, false]) == ({other} in [true, false])", f"{one} == {other}")
        case (Field(path), Term(kind="number" | "text") as term) | (Term(kind="number" | "text") as term, Field(path)):
            return _where(f"!({field(path)} in [true, false])", f"{field(path)} == {inner(term)}")
        case Term(_, one), Term(_, other) if one == other:
            return Term(f"{inner(left)} == {inner(right)}", "bool")
    raise UntranslatableError


def _field_is(text: str, value: object) -> Value:
    if isinstance(value, bool) or (isinstance(value, int | float) and value in (0, 1)):
        return Term(f"{text} in [{'true, 1' if value else 'false, 0'}]", "bool")
    if isinstance(value, list | tuple) and any(isinstance(v, bool | list | tuple) or v in (0, 1) for v in value):
        raise UntranslatableError
    return Term(f"{text} == {literal(value)}", "bool")


def _where(test: str, then: str) -> Term:
    return Term(f"({test}) ? ({then}) : ({STUB})", "bool")


def _plain(value: float) -> float:
    return int(value) if isinstance(value, bool) else value


def _is(left: Leaf, right: Leaf) -> Value:
    match left, right:
        case Const(a), Const(None | bool() as b):
            return Const(a is b)
        case Field(path), Const(None | bool() as b):
            return Term(f"{field(path)} == {literal(b)}", "bool")
        case Term(), Const(None):
            return FALSE
    raise UntranslatableError


def inside(left: Leaf, right: Leaf) -> Value:
    """`in`: of a constant's items, of a text, of the message's fields."""
    match left, right:
        case Const(a), Const(list() | tuple() | set() | frozenset() | dict() as b):
            found: Value = FALSE
            for item in b:
                found = choice(equal(Const(a), Const(item)), TRUE, found)
            return found
        case Const(str() as a), Const(str() as b):
            return Const(a in b)
        case _, Const(list() | tuple() | set() | frozenset() | dict() as b):
            return _any_of(left, [Const(item) for item in b])
        case _, Items(values):
            return _any_of(left, list(values))
        case Const(str() as key), Field(path):
            return Term(f"{field(path)}.contains({literal(key)})", "bool", tight=True)
        case Const(str() as key), Message():
            return has((key,))
    raise UntranslatableError


def _any_of(left: Leaf, values: list[Value]) -> Value:
    known = [v.value for v in values if isinstance(v, Const)]
    if isinstance(left, Field) and len(known) == len(values) > 0 and all(_plainly_equal(v) for v in known):
        return Term(f"{field(left.path)} in {literal(known)}", "bool")
    found: Value = FALSE
    for value in reversed(values):
        found = choice(each(value, lambda item: equal(left, item)), TRUE, found)
    return found


def _plainly_equal(value: object) -> bool:
    """Whether CEL finds the same values equal to this one as Python: not to 0 and 1, which are False and True there."""
    return isinstance(value, str) or (isinstance(value, int | float) and value not in (0, 1))


def _ordered(left: Leaf, op: ast.cmpop, right: Leaf) -> Value:
    word, work = _ORDER[type(op)]
    match left, right:
        case Const(a), Const(b):
            try:
                return Const(work(a, b))
            except TypeError:
                return Raises("TypeError")
    one, other = _operand(left), _operand(right)
    if one is None or other is None:
        return Raises("TypeError")
    return Term(f"{one} {word} {other}", "bool")


def _operand(leaf: Leaf) -> str | None:
    """What is compared by size; None where Python can't."""
    match leaf:
        case Const(bool() as value):
            return literal(int(value))
        case Const(int() | float() | str() as value):
            return literal(value)
        case Const(None | list() | dict()):
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


def _arithmetic(left: Leaf, op: ast.operator, right: Leaf) -> Value:
    word, work = _ARITHMETIC.get(type(op), (None, operator.add))
    if word is None or (word == "//" and not (isinstance(left, Const) and isinstance(right, Const))):
        raise UntranslatableError
    match left, right:
        case Const(a), Const(b):
            return _known(word, work, a, b)
        case (Const(str()) | Term(kind="text"), _) | (_, Const(str()) | Term(kind="text")):
            return Term(f"{_text(left)} + {_text(right)}", "text") if word == "+" else _untranslatable()
        case ((Field() | Term(kind="number")), Const(int() as base)) if word == "%" and 0 < base < 2**31:
            return _remainder(left, base)
        case _, Const(int() as power) if word == "**" and 2 <= power <= 4:
            return Term("(" + " * ".join([number(left)] * power) + ")", "number", tight=True)
    if word in ("%", "**"):
        raise UntranslatableError
    return Term(f"({number(left)} {word} {number(right)})", "number", tight=True)


def _remainder(left: Leaf, base: int) -> Value:
    if isinstance(left, Term) and not left.whole:
        raise UntranslatableError
    text = field(left.path) if isinstance(left, Field) else inner(left)  # type: ignore[arg-type]
    return Term(f"(({text} % {base} + {base}) % {base})", "number", tight=True, whole=True)


def _untranslatable() -> Value:
    raise UntranslatableError


def _text(leaf: Leaf) -> str:
    match leaf:
        case Const(str() as value):
            return literal(value)
        case Field(path):
            return field(path)
        case Term(_, "text"):
            return inner(leaf)
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
