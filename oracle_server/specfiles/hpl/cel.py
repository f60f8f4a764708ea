"""Predicates of HPL as expressions over `msg`."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping

from oracle_server.specfiles.hpl.tree import (
    Binary,
    Call,
    Constant,
    Expr,
    Group,
    NoCounterpartError,
    Number,
    Quantified,
    Range,
    Reference,
    Text,
    Truth,
    Unary,
)

FUNCTIONS = {"abs": "abs", "sqrt": "sqrt", "len": "size", "max": "max", "min": "min"}
"""The functions that both have, by their names in HPL."""
_OR, _AND, _COMPARED, _SUM, _PRODUCT, _SIGN, _VALUE = range(7)
_SIGNS = {
    "or": ("||", _OR),
    "and": ("&&", _AND),
    "=": ("==", _COMPARED),
    "!=": ("!=", _COMPARED),
    "<": ("<", _COMPARED),
    "<=": ("<=", _COMPARED),
    ">": (">", _COMPARED),
    ">=": (">=", _COMPARED),
    "+": ("+", _SUM),
    "-": ("-", _SUM),
    "*": ("*", _PRODUCT),
}
_CAPITALS = re.compile(r"[A-Z][A-Z0-9_]*")
_Written = tuple[str, int]
"""An expression, and how tightly it binds."""
_Inner = Callable[[Expr, int], str]
"""Writes a part, in parentheses where it binds less tightly than it must there."""
_Variables = Mapping[str, Reference | None]
"""The variables of quantifiers, with the array whose indexes they are; None for one that runs over a set."""


def cel(expr: Expr, own: str) -> str:
    """An expression over the message whose alias is `own`, or empty. Raises `NoCounterpartError`, with its place."""
    return _written(expr, frozenset((own, "")), {})[0]


def _written(expr: Expr, own: frozenset[str], variables: _Variables) -> _Written:
    def inner(part: Expr, least: int) -> str:
        text, binds = _written(part, own, variables)
        return text if binds >= least else f"({text})"

    match expr:
        case Reference():
            found = _reference(expr, own, variables, inner), _VALUE
        case Unary():
            sign = "!" if expr.sign == "not" else "-"
            found = f"{sign}{inner(expr.operand, _VALUE)}", _SIGN
        case Group():
            found = f"[{', '.join(inner(each, _OR) for each in expr.items)}]", _VALUE
        case Call():
            found = _call(expr, inner), _VALUE
        case Binary():
            found = _binary(expr, inner)
        case Quantified():
            found = _quantified(expr, inner, own, variables), _VALUE
        case _:
            found = _literal(expr), _VALUE
    return found


def _literal(expr: Number | Text | Truth | Constant | Range) -> str:
    match expr:
        case Number():
            return _number(expr.text)
        case Text():
            return json.dumps(expr.value, ensure_ascii=False)
        case Truth():
            return "true" if expr.value else "false"
        case Constant():
            return _constant(expr)
        case Range():
            raise NoCounterpartError("a range stands behind `in` alone", expr.at)


def _number(text: str) -> str:
    """A number as expressions have it: with digits on both sides of its point."""
    whole, point, rest = text.partition(".")
    if not point:
        return text
    digits, mark, exponent = rest.lower().partition("e")
    return f"{whole or '0'}.{digits or '0'}{mark}{exponent}"


def _constant(expr: Constant) -> str:
    if expr.name in ("PI", "E"):
        return repr(math.pi if expr.name == "PI" else math.e)
    raise NoCounterpartError(f"`{expr.name}` is no number that can be written", expr.at)


def _reference(expr: Reference, own: frozenset[str], variables: _Variables, inner: _Inner) -> str:
    text, steps = _begun(expr, own, variables)
    last = steps[-1] if steps else ""
    if isinstance(last, str) and _CAPITALS.fullmatch(last):
        message = f"`{last}` looks like a constant of the message's type, of which HPL does not say the value"
        raise NoCounterpartError(message, expr.at)
    for step in steps:
        text += f".{step}" if isinstance(step, str) else f"[{inner(step, _OR)}]"
    return text


def _begun(expr: Reference, own: frozenset[str], variables: _Variables) -> tuple[str, tuple[str | Expr, ...]]:
    """What a reference begins with, and the steps that are left from there: `a[@i]` is the element itself."""
    if expr.alias in variables:
        if variables[expr.alias] is None:
            return expr.alias, expr.steps
        told = f"`@{expr.alias}` may be an index or an element: HPL's tools differ; `array[@{expr.alias}]` is clear"
        raise NoCounterpartError(told, expr.at)
    for name, array in variables.items():
        if array is not None and array.alias == expr.alias:
            length = len(array.steps)
            if expr.steps[: length + 1] == (*array.steps, Reference(0, 0, name, ())):
                return name, expr.steps[length + 1 :]
    if expr.alias in own:
        return "msg", expr.steps
    raise NoCounterpartError(f"`@{expr.alias}` can't be taken here", expr.at)


def _call(expr: Call, inner: _Inner) -> str:
    name = FUNCTIONS.get(expr.name)
    if name is None:
        raise NoCounterpartError(f"there is no function `{expr.name}`", expr.at)
    return f"{name}({', '.join(inner(each, _OR) for each in expr.arguments)})"


def _binary(expr: Binary, inner: _Inner) -> _Written:
    left, right = expr.left, expr.right
    if expr.sign in _SIGNS:
        sign, binds = _SIGNS[expr.sign]
        tight = binds + (binds == _COMPARED)
        return f"{inner(left, tight)} {sign} {inner(right, binds + (binds not in (_OR, _AND)))}", binds
    match expr.sign:
        case "/":
            return f"{inner(left, _PRODUCT)} * 1.0 / {inner(right, _SIGN)}", _PRODUCT
        case "implies":
            return f"!{inner(left, _VALUE)} || {inner(right, _OR)}", _OR
        case "iff":
            return f"{inner(left, _SUM)} == {inner(right, _SUM)}", _COMPARED
        case "in":
            return _contained(left, right, inner)
        case _:
            raise NoCounterpartError(f"there is no `{expr.sign}`", expr.at)


def _contained(value: Expr, container: Expr, inner: _Inner) -> _Written:
    match container:
        case Range():
            low, high = inner(container.low, _SUM), inner(container.high, _SUM)
            text = inner(value, _SUM)
            above, below = ">" if container.above else ">=", "<" if container.below else "<="
            return f"{text} {above} {low} && {text} {below} {high}", _AND
        case Group() | Reference():
            return f"{inner(value, _SUM)} in {inner(container, _VALUE)}", _COMPARED
        case _:
            raise NoCounterpartError("behind `in` stands a range, a set or a field", container.at)


def _quantified(expr: Quantified, inner: _Inner, own: frozenset[str], variables: _Variables) -> str:
    if expr.variable == "msg":
        raise NoCounterpartError("a variable can't be called `msg`", expr.at)
    array = _array(expr.domain)
    if array is None and not isinstance(expr.domain, Group):
        raise NoCounterpartError(f"`{expr.word}` runs over a set, or over all of an array", expr.domain.at)
    domain = inner(array, _VALUE) if array else inner(expr.domain, _VALUE)
    name = "all" if expr.word == "forall" else "exists"
    body, _ = _written(expr.body, own, {**variables, expr.variable: array})
    return f"{domain}.{name}({expr.variable}, {body})"


def _array(domain: Expr) -> Reference | None:
    """The array over whose indexes a variable runs, None where it runs over anything else."""
    match domain:
        case Reference():
            return domain
        case Range(
            low=Number(text="0"), high=Call(name="len", arguments=(Reference() as array,)), above=False, below=True
        ):
            return array
        case _:
            return None
