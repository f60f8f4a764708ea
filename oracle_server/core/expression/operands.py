"""Whether operands that are known fit an operator: what is wrong, None where nothing is, in a sentence with a mend."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from oracle_server.core.expression import times
from oracle_server.core.expression.spans import Span
from oracle_server.core.expression.static import (
    INFINITE,
    NOT_FINITE,
    Elements,
    Static,
    described,
    is_number,
    is_text,
    kind,
    not_single,
)
from oracle_server.core.expression.tree import Literal, Node
from oracle_server.core.shapes import Many, Record, Value

_NUMBER = re.compile(r"[+-]?\d+(\.\d+)?", re.ASCII)


@dataclass(frozen=True, slots=True)
class Operand:
    """A part of an expression: its text, and what is known of its value; `span` where that is a number."""

    node: Node
    text: str
    static: Static
    span: Span | None = None

    def __str__(self) -> str:
        literal = isinstance(self.node, Literal)
        return f"`{self.text}`" if literal else f"`{self.text}` is {described(self.static)}"


def not_inside(one: Operand, other: Operand) -> str:
    """What is wrong with asking whether a value is in a single one."""
    if kind(other.static) == "bytes":
        return f"{other}, and no list{not_single(other.static, other.text)}"
    if kind(other.static) == "text":
        return f"{other}, and no list; write `{other.text}.contains({one.text})`"
    return f"{other}, and `in` takes a list behind it"


def arithmetic(mark: str, one: Operand, other: Operand) -> str | None:
    """What is wrong with an operation on two values."""
    if mark == "+" and is_text(one.static) and is_text(other.static):
        return None
    if mark == "+" and all(isinstance(o.static, Many | Elements) for o in (one, other)):
        return None
    for operand, beside in ((one, other), (other, one)):
        if operand.static is None or is_number(operand.static):
            continue
        if mark == "+" and is_text(operand.static):
            if beside.static is None:
                continue
            of = "" if isinstance(beside.node, Literal) else f", which is {described(beside.static)}"
            told = f"{operand}, and" if not isinstance(operand.node, Literal) else f"`{operand.text}` is a text, and"
            return f"{told} can't be added to `{beside.text}`{of}; for a text write `string({beside.text})`"
        return f"{operand}, and `{mark}` takes numbers{_number_of(operand)}"
    if mark == "%" and "real" in (kind(one.static), kind(other.static)):
        real = one if kind(one.static) == "real" else other
        return f"{real}, and `%` takes whole numbers; write `int({real.text})`"
    return None


def boolean(mark: str, operand: Operand) -> str | None:
    """What is wrong with a value that has to be true or false."""
    static = operand.static
    if static is None or kind(static) == "bool":
        return None
    mend = f"`{operand.text} != 0`" if is_number(static) else f"`{operand.text} == 'on'`"
    if isinstance(static, Many | Elements):
        mend = f"`size({operand.text}) > 0`"
    elif isinstance(static, Record):
        mend = f"`{operand.text}.field == 1`"
    return f"{operand}, and `{mark}` takes what is true or false; write a comparison, such as {mend}"


def compared(mark: str, one: Operand, other: Operand) -> str | None:
    """What is wrong with a comparison of two values."""
    return (equal if mark in ("==", "!=") else ordered)(mark, one, other)


def by_letters(mark: str, one: Operand, other: Operand) -> Iterator[str]:
    """What is said of an order with a number in quotes, which is one of texts."""
    if mark in ("==", "!="):
        return
    for text, beside, mend in ((one, other, "{0} {1} double({2})"), (other, one, "double({2}) {1} {0}")):
        value = text.node.value if isinstance(text.node, Literal) else None
        if isinstance(value, str) and _NUMBER.fullmatch(value) and not isinstance(beside.node, Literal):
            yield (
                f"{text} is a text, and texts are compared letter by letter, where '10' comes before '9'; write "
                f"`{mend.format(value, mark, beside.text)}` for numbers"
            )


def ordered(mark: str, one: Operand, other: Operand) -> str | None:
    """What is wrong with an order of two values."""
    for operand in (one, other):
        if isinstance(operand.static, Many | Elements | Record):
            return f"{operand}, and `{mark}` takes two numbers or two texts{_single(operand)}"
    if any(kind(a.static) == "real" and _names(b, INFINITE) for a, b in ((one, other), (other, one))):
        return None
    return _unlike(f"and `{mark}` takes two numbers or two texts", one, other)


def equal(mark: str, one: Operand, other: Operand) -> str | None:
    """What is wrong with an equality: values of two kinds are never equal."""
    return _equal(one, other, f"so that this is always {'true' if mark == '!=' else 'false'}")


def never_matching(one: Operand, items: Sequence[Operand]) -> list[tuple[Operand, str]]:
    """The items of a list that a value is never equal to, and what is to be said of each."""
    found = []
    for item in items:
        if equal("in", one, item) is not None:
            why = f"{one}" if isinstance(item.node, Literal) else f"{one} and {item}"
            mend = "" if kind(one.static) == "bool" else _converted(one, item)
            found.append((item, f"the item `{item.text}` of the list never matches, as {why}{mend}"))
    return found


def outside(one: Operand, first: Operand) -> str | None:
    """What is wrong with a value that equals no item of a list, of which this is the first."""
    return _equal(one, first, "and no item of the list can match, so that this is always false")


def _equal(one: Operand, other: Operand, outcome: str) -> str | None:
    for a, b in ((one, other), (other, one)):
        if kind(a.static) == "real" and _names(b, NOT_FINITE):
            if (isinstance(a.static, Value) and a.static.type) or _names(b, INFINITE):
                return None
            return f"`{a.text}` is computed, and is never the text {b.text}"
    return _unlike(outcome, one, other)


def _names(operand: Operand, texts: frozenset[str]) -> bool:
    return isinstance(operand.node, Literal) and operand.node.value in texts


def _unlike(outcome: str, one: Operand, other: Operand) -> str | None:
    sorts = [_sort(operand.static) for operand in (one, other)]
    if None in sorts or sorts[0] == sorts[1]:
        return None
    return f"{one} and {_plain(other)}, {outcome}{_converted(one, other)}"


def _sort(static: Static) -> str | None:
    """What a value can be compared with, None where it is not known."""
    if is_number(static):
        return "number"
    if is_text(static):
        return "text"
    if isinstance(static, Many | Elements):
        return "list"
    return "message" if isinstance(static, Record) else kind(static)


def _converted(one: Operand, other: Operand) -> str:
    """How one operand is to be written for both to be of one kind."""
    for a, b in ((one, other), (other, one)):
        if not isinstance(b.node, Literal):
            continue
        value: object = b.node.value
        if kind(a.static) == "bool" and str(value).lower() in ("true", "false", "1", "0"):
            return f"; write `{'' if str(value).lower() in ('true', '1') else '!'}{a.text}`"
        if is_number(a.static) and type(value) is str and value.replace(".", "", 1).lstrip("-").isdigit():
            return f"; write {value} without quotes"
        if kind(a.static) == "text" and type(value) is int:
            return f"; write '{value}' in quotes"
    return ""


def _plain(operand: Operand) -> str:
    return str(operand).replace(" is ", ", ", 1) if isinstance(operand.node, Literal) else str(operand)


def _number_of(operand: Operand) -> str:
    static = operand.static
    if is_text(static) and not isinstance(operand.node, Literal):
        return f"; write `double({operand.text})` where the text is a number"
    if kind(static) == "bool":
        return f"; write `({operand.text} ? 1 : 0)`"
    return _single(operand)


def _single(operand: Operand) -> str:
    if isinstance(operand.static, Many | Elements):
        return f"; write `{operand.text}[0]` for one element, or `size({operand.text})`"
    if isinstance(operand.static, Record) and operand.static.fields:
        return f"; {times.single(operand.text, operand.static.fields)}"
    return ""
