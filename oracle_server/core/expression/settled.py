"""Comparisons that come to the same whatever the message says, each with the reason and a mend."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from oracle_server.core.expression.operands import Operand
from oracle_server.core.expression.static import NOT_FINITE, is_number, kind
from oracle_server.core.expression.tree import Call, Chain, Compare, Joined, Literal, Loop, Node, Variable, walk
from oracle_server.core.shapes import WHOLE_NUMBERS, Value

_FLIPPED = {"<": ">", ">": "<", "<=": ">=", ">=": "<="}
_NAMES = {"nan": "NaN", "inf": "Infinity", "infinity": "Infinity"}
Settled = tuple[bool, str]
"""What a comparison always comes to, and why."""


def settled(mark: str, one: Operand, other: Operand, number: Operand | None) -> Settled | None:
    """What a comparison by `==`, `!=` or an order always comes to; None where both is possible, or nothing is known.

    `number` is what one side makes a text by `string`, where it does.
    """
    if isinstance(one.node, Literal):
        one, other, mark = other, one, _FLIPPED.get(mark, mark)
    if not isinstance(other.node, Literal):
        return None
    value = other.node.value
    if isinstance(value, int | float) and not isinstance(value, bool):
        return _by_range(mark, one, value)
    if mark not in ("==", "!="):
        return None
    why = never_text(one, other) or (never_named(mark, number, other) if number else None)
    return (mark == "!=", why) if why else None


def itself(mark: str, one: Operand, other: Operand) -> Settled | None:
    """What the equality of a part of the message with itself comes to."""
    if mark not in ("==", "!=") or one.text != other.text:
        return None
    if one.static is None or kind(one.static) == "real":
        instead = "!=" if mark == "==" else "=="
        return mark == "==", f"both sides are the same; where NaN is meant, write `{one.text} {instead} 'NaN'`"
    return mark == "==", "both sides are the same"


def never_text(one: Operand, other: Operand) -> str | None:
    """Why a text never equals one that is written out, nor has it as a part; None where it may."""
    value = other.node.value if isinstance(other.node, Literal) else None
    made = _untrimmed(one.node)
    if not isinstance(value, str) or not isinstance(made, Call) or made.name not in ("lower", "upper"):
        return None
    small = made.name == "lower"
    if not any(c.isascii() and (c.isupper() if small else c.islower()) for c in value):
        return None
    mend = "" if "\\" in other.text else f"; write `{other.text.lower() if small else other.text.upper()}`"
    return f"`{made.name}` gives {'small' if small else 'capital'} letters{mend}"


def never_named(mark: str, number: Operand, other: Operand) -> str | None:
    """Why a number as a text never is some name of NaN or of an infinity that is written out; None where it may be."""
    value = other.node.value if isinstance(other.node, Literal) else None
    if not isinstance(number.static, Value) or not is_number(number.static) or not isinstance(value, str):
        return None
    name = _NAMES.get(value.lower().lstrip("+-"))
    if name is None or value in NOT_FINITE or (name == "Infinity" and not number.static.type):
        return None
    name = f"-{name}" if value.startswith("-") and name == "Infinity" else name
    return f"its name here is '{name}'; write `{number.text} {mark} '{name}'`"


def ends(node: Joined, text: str) -> Iterator[Compare]:
    """The orders of a part with numbers that stand beside another such order of it: the ends of an interval."""
    found: dict[str, list[Compare]] = {}
    for part in node.parts:
        if isinstance(part, Compare) and part.mark in _FLIPPED:
            side = part.right if isinstance(part.left, Literal) else part.left
            found.setdefault("".join(text[side.start : side.end].split()), []).append(part)
    for parts in found.values():
        if len(parts) > 1:
            yield from parts


def _untrimmed(node: Node) -> Node:
    while isinstance(node, Call) and node.name == "trim":
        node = node.arguments[0]
    return node


def unread(node: Loop, body: str) -> str | None:
    """What is said of a comprehension that asks the same of each element; None where it reads the element."""
    read = {
        part.name for under in (node.body, node.when) if under for part in walk(under) if isinstance(part, Variable)
    }
    if node.variable in read or isinstance(node.body, Literal):
        return None
    return f"`{body}` reads nothing of `{node.variable}`, so that `{node.kind}` asks the same of each element"


def _by_range(mark: str, one: Operand, number: float) -> Settled | None:
    found = _bounds(one)
    if found is None:
        return None
    least, most, is_whole, what = found
    never = {
        "==": not least <= number <= most or (is_whole and number != int(number)),
        "<": least >= number, "<=": least > number, ">": most <= number, ">=": most < number,
    }  # fmt: skip
    always = {
        "!=": never["=="],
        "<": most < number, "<=": most <= number, ">": least > number, ">=": least >= number,
    }  # fmt: skip
    if never.get(mark):
        return False, f"`{one.text}` {what}"
    return (True, f"`{one.text}` {what}") if always.get(mark) else None


def _bounds(one: Operand) -> tuple[float, float, bool, str] | None:
    """The least and the largest value of a part, whether it is a whole number, and this in words."""
    match one.node:
        case Call(name="size"):
            return 0, 2**63, True, "is always a whole number that is not negative"
        case Call(name="abs" | "sqrt"):
            return 0, inf, False, "is never negative"
        case Chain(rest=[*_, ("%", Literal(int(by)))]) if by:
            most = abs(by) - 1
            return -most, most, True, f"is what is left of a division by {by}, and at most {most}"
    if isinstance(one.static, Value) and one.static.kind == "whole" and one.static.type in WHOLE_NUMBERS:
        least, largest = WHOLE_NUMBERS[one.static.type]
        return least, largest, True, f"is {one.static.type}, always a whole number from {least} to {largest}"
    return None
