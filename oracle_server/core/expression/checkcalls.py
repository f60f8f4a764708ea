"""What is known of the value of a call, and what is wrong with its arguments."""

from __future__ import annotations

from typing import Literal

from oracle_server.core.expression.operands import Operand
from oracle_server.core.expression.static import (
    BOOL,
    REAL,
    TEXT,
    WHOLE,
    Elements,
    Static,
    element,
    is_number,
    is_text,
    kind,
)
from oracle_server.core.expression.tree import Call
from oracle_server.core.shapes import Many, Record, Value

_Told = list[tuple[Literal["error", "warning"], str]]
_MAKES: dict[str, Static] = {
    "double": REAL,
    "int": WHOLE,
    "size": WHOLE,
    "sqrt": REAL,
    "string": TEXT,
    "uint": WHOLE,
}


def called(node: Call, arguments: list[Operand]) -> tuple[Static, _Told]:  # noqa: PLR0911 -- a case a function
    """What is known of a call's value, and what is wrong with the call."""
    match node.name:
        case "todo" | "unknown":
            return None, []
        case "size":
            return WHOLE, _size(arguments[0])
        case "abs" | "sqrt":
            told = _numbers(node.name, arguments)
            return REAL if node.name == "sqrt" else _same(arguments[0].static), told
        case "min" | "max":
            return _picked(node.name, arguments)
        case "string" | "double" | "int" | "uint":
            return _MAKES[node.name], _converted(node.name, arguments[0])
        case "lower" | "trim" | "upper":
            return TEXT, _texts(node.name, arguments)
        case _:
            return BOOL, _texts(node.name, arguments)


def _same(static: Static) -> Static:
    """What is known of a number without its sign."""
    return Value(static.kind, "") if isinstance(static, Value) else None


def _size(operand: Operand) -> _Told:
    static = operand.static
    if kind(static) == "bytes":
        return [("warning", f"{operand}; `size` counts the characters of that text, four for each three bytes")]
    if isinstance(static, Record) or (isinstance(static, Value) and not is_text(static)):
        return [("error", f"{operand}, and `size` takes a list or a text")]
    return []


def _numbers(name: str, arguments: list[Operand]) -> _Told:
    wrong = [o for o in arguments if o.static is not None and not is_number(o.static)]
    return [("error", f"{operand}, and `{name}` takes numbers") for operand in wrong]


def _picked(name: str, arguments: list[Operand]) -> tuple[Static, _Told]:
    found = [operand.static for operand in arguments]
    if len(arguments) == 1:
        if isinstance(found[0], Value | Record):
            return None, [("error", f"{arguments[0]}, and `{name}` takes several numbers, or a list of numbers")]
        found = [element(found[0])]
        if found[0] is not None and not is_number(found[0]):
            return None, [("error", f"{arguments[0]}, and `{name}` takes numbers")]
        told: _Told = []
    else:
        told = _numbers(name, arguments)
    kinds = {kind(static) for static in found}
    if kinds == {"whole"}:
        return WHOLE, told
    return (REAL if "real" in kinds else None), told


def _converted(name: str, operand: Operand) -> _Told:
    static = operand.static
    if kind(static) == "bool":
        mends = {"string": f"({operand.text} ? 'true' : 'false')"}
        mend = mends.get(name, f"({operand.text} ? 1 : 0)")
        return [("error", f"{operand}, and `{name}` takes a number or a text; write `{mend}`")]
    if isinstance(static, Many | Elements | Record):
        return [("error", f"{operand}, and `{name}` takes a number or a text")]
    return []


def _texts(name: str, arguments: list[Operand]) -> _Told:
    first, *others = arguments
    if isinstance(first.static, Many | Elements) and name == "contains":
        return [("error", f"{first}, and no text; write `{others[0].text} in {first.text}`")]
    for operand in arguments:
        if operand.static is None or is_text(operand.static):
            continue
        mend = f"; write `string({operand.text})`" if is_number(operand.static) else ""
        return [("error", f"{operand}, and `{name}` takes texts{mend}")]
    return []
