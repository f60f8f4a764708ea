"""Comparisons that come to the same whatever the message says, each with the reason and a mend."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor

from oracle_server.core.expression.operands import Operand
from oracle_server.core.expression.spans import Span, reads
from oracle_server.core.expression.static import NOT_FINITE, is_number, kind
from oracle_server.core.expression.tree import Call, Compare, Joined, Literal, Loop, Node, Variable, walk
from oracle_server.core.expression.values import ORDER
from oracle_server.core.shapes import Value

_NAMES = {"nan": "NaN", "inf": "Infinity", "infinity": "Infinity"}
Settled = tuple[bool, str]
"""What a comparison always comes to, and why."""


def settled(mark: str, one: Operand, other: Operand, number: Operand | None) -> Settled | None:
    """What a comparison by `==`, `!=` or an order always comes to; None where both is possible, or nothing is known.

    `number` is what one side makes a text by `string`, where it does.
    """
    found = _by_span(mark, one, other)
    if found is not None or mark not in ("==", "!="):
        return found
    if isinstance(one.node, Literal):
        one, other = other, one
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
        if isinstance(part, Compare) and part.mark in ORDER:
            side = part.right if isinstance(part.left, Literal) else part.left
            found.setdefault("".join(text[side.start : side.end].split()), []).append(part)
    for parts in found.values():
        if len(parts) > 1:
            yield from parts


def is_of_a_length(*sides: Operand) -> bool:
    """Whether a comparison asks how long a list is that is always as long: that may guard what reads its elements."""
    return any(
        isinstance(o.node, Call) and o.node.name == "size" and o.span is not None and o.span.least == o.span.most
        for o in sides
    )


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


def _by_span(mark: str, one: Operand, other: Operand) -> Settled | None:
    a, b = one.span, other.span
    if a is None or b is None or not (reads(one.node) or reads(other.node)):
        return None
    apart = a.most < b.least or b.most < a.least or _no_whole(a, b) or _no_whole(b, a)
    same = a.least == a.most == b.least == b.most
    outcomes = {
        "==": (same, apart), "!=": (apart, same),
        "<": (a.most < b.least, a.least >= b.most), "<=": (a.most <= b.least, a.least > b.most),
        ">": (a.least > b.most, a.most <= b.least), ">=": (a.least >= b.most, a.most < b.least),
    }  # fmt: skip
    always, never = outcomes.get(mark, (False, False))
    if not (always or never):
        return None
    return always, " and ".join(f"`{o.text}` {o.span}" for o in (one, other) if reads(o.node))


def _no_whole(one: Span, other: Span) -> bool:
    """Whether one has whole numbers alone, and the other a single one that is none."""
    return one.whole and other.least == other.most and other.least != floor(other.least)
