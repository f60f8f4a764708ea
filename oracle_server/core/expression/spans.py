"""Between which numbers a part of an expression is, wherever it comes to a number: by intervals, from its operands'.

The ends are computed as the values are. Each operation keeps the order of numbers, and so does the rounding of real
ones, so that no value lies beyond the ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import product

from oracle_server.core.expression.static import Static, element, is_number, kind
from oracle_server.core.expression.tree import (
    Call,
    Chain,
    Choice,
    Index,
    ListOf,
    Literal,
    Loop,
    Node,
    Path,
    Unary,
    Variable,
    key_of,
    walk,
)
from oracle_server.core.shapes import UNIT, WHOLE_NUMBERS, Many, Value

Known = Callable[[Node], Static]
"""What is known of the value of a part."""
_INT = (-(2**63), 2**63 - 1)
_UINT = (0, 2**64 - 1)
_EXACT = 2**53
"""Beyond, not every whole number is a real one."""
_SHORT = 2**32


@dataclass(frozen=True, slots=True)
class Span:
    """All numbers from the least to the most, both of them within; `whole`: only whole ones. `named`: as what."""

    least: float
    most: float
    whole: bool = False
    named: str = ""

    def __str__(self) -> str:
        """In words, behind the part whose values these are."""
        return f"is {self.named}, {self._words()}" if self.named else f"is {self._words()}"

    def _words(self) -> str:
        low, high = self.least > -_SHORT, self.most <= _SHORT
        what = "a whole number" if self.whole else "a number"
        if self.least == self.most:
            return f"always {self.least}"
        if self.named or (low and high):
            return f"always {what} from {self.least} to {self.most}"
        if low and self.least == 0:
            return "always a whole number that is not negative" if self.whole else "never negative"
        if low or high:
            return f"always {what} of at {f'least {self.least}' if low else f'most {self.most}'}"
        return f"always {what}"


WHOLE, REAL = Span(_INT[0], _UINT[1], whole=True), Span(-math.inf, math.inf)


class Spans:
    """The spans of the parts of one expression, by what is known of the value of each."""

    def __init__(self, known: Known) -> None:
        self.known = known
        self._found: dict[int, Span | None] = {}

    def of(self, node: Node) -> Span | None:
        """The numbers that a part can be, None where it may be none, or nothing is known."""
        if id(node) not in self._found:
            self._found[id(node)] = self._of(node) or _typed(self.known(node))
        return self._found[id(node)]

    def _of(self, node: Node) -> Span | None:
        match node:
            case Literal(value=int() | float() as value) if not isinstance(value, bool) and math.isfinite(value):
                return Span(value, value, isinstance(value, int))
            case Unary("-", of):
                found = self._number(of)
                return _within((-found.least, -found.most), whole=found.whole)
            case Chain():
                return self._chain(node)
            case Choice(cases=cases, otherwise=otherwise):
                return _hull([self.of(part) for part in (*(value for _, value in cases), otherwise)])
            case Call():
                return self._call(node)
            case _:
                return None

    def _number(self, node: Node) -> Span:
        """The numbers that a part can be which is taken for one, and fails where it is none."""
        return self.of(node) or REAL

    def _chain(self, node: Chain) -> Span | None:
        found, before = self.of(node.first), node.first
        for i, (mark, part) in enumerate(node.rest):
            other = self.of(part)
            if mark == "*" and i == 0 and key_of(before) == key_of(part):
                found = _square(found or REAL)
            elif mark != "+" or found is not None or other is not None:  # else both may be texts, or lists
                found = _computed(mark, found or REAL, other or REAL, part)
        return found

    def _call(self, node: Call) -> Span | None:
        match node.name:
            case "min" | "max":
                return self._picked(node)
            case "size":
                least, most = self._length(node.arguments[0]) or (0, _INT[1])
                return Span(least, most, whole=True)
            case _:
                make = _MADE.get(node.name)
                return None if make is None else make(self._number(node.arguments[0]))

    def _picked(self, node: Call) -> Span:
        """Of one list what its elements can be, of several numbers what the least, or the largest, can."""
        (first, *others) = node.arguments
        if others:
            found = [self._number(argument) for argument in node.arguments]
        elif isinstance(first, ListOf) and first.items:
            found = [self._number(item) for item in first.items]
        else:
            found = [_typed(element(self.known(first))) or REAL]
        pick = min if node.name == "min" else max
        least, most = pick(f.least for f in found), pick(f.most for f in found)
        return _within((least, most), whole=all(f.whole for f in found))

    def _length(self, of: Node) -> tuple[int, int] | None:
        """The least and the most elements of a list, None where that is not known."""
        if isinstance(of, ListOf):
            return len(of.items), len(of.items)
        if isinstance(of, Loop) and of.kind in ("map", "filter"):
            found = self._length(of.of)
            some = of.kind == "filter" or of.when is not None
            return found and (0 if some else found[0], found[1])
        static = self.known(of)
        length = static.length if isinstance(static, Many) else None
        return None if length is None else (length, length)


def reads(node: Node) -> bool:
    """Whether a part has anything of the message in it."""
    return any(isinstance(part, Path | Variable | Index) for part in walk(node))


def _typed(static: Static) -> Span | None:
    """The numbers of a field, or of what is known to be computed."""
    if not is_number(static):
        return None
    if kind(static) == "real":
        return Span(*UNIT) if isinstance(static, Value) and static.unit else REAL
    if isinstance(static, Value) and static.type in WHOLE_NUMBERS:
        return Span(*WHOLE_NUMBERS[static.type], whole=True, named=static.type)
    return WHOLE


def _within(ends: Iterable[float], *, whole: bool) -> Span:
    """The span between ends, as far as numbers reach: whole ones have 64 bits, and fail beyond."""
    found = [end for end in ends if not math.isnan(end)] or [-math.inf, math.inf]
    least, most = min(found), max(found)
    if not whole:
        return Span(least if least >= -_EXACT else -math.inf, most if most <= _EXACT else math.inf)
    least, most = max(least, WHOLE.least), min(most, WHOLE.most)
    return Span(least, most, whole=True) if least <= most else WHOLE


def _hull(found: Iterable[Span | None]) -> Span | None:
    """What is in one of some spans or between them."""
    known = []
    for span in found:
        if span is None:
            return None
        known.append(span)
    return _within((end for s in known for end in (s.least, s.most)), whole=all(s.whole for s in known))


def _computed(mark: str, one: Span, other: Span, part: Node) -> Span:
    """What an operation makes of two numbers; `part` is the second operand."""
    whole = one.whole and other.whole
    match mark:
        case "+":
            return _within((one.least + other.least, one.most + other.most), whole=whole)
        case "-":
            return _within((one.least - other.most, one.most - other.least), whole=whole)
        case "*":
            return _within((_times(a, b) for a, b in _corners(one, other)), whole=whole)
        case "/":
            return _divided(one, other, whole=whole)
        case _:
            return _left(one, other, part)


def _corners(one: Span, other: Span) -> Iterable[tuple[float, float]]:
    return product((one.least, one.most), (other.least, other.most))


def _times(one: float, other: float) -> float:
    return one * other if one and other else 0  # nothing of infinitely many is no number, and compares with none


def _square(span: Span) -> Span:
    ends = [span.least * span.least, span.most * span.most]
    return _within([*ends, *([0] if span.least <= 0 <= span.most else [])], whole=span.whole)


def _divided(one: Span, other: Span, *, whole: bool) -> Span:
    if other.least <= 0 <= other.most:
        most = max(abs(one.least), abs(one.most))
        return _within((-most, most), whole=True) if whole else REAL
    if whole:
        found = [_shared(int(a), int(b)) for a, b in _corners(one, other)]
        return _within(found, whole=True)
    exact = [a / b for a, b in _corners(one, other) if math.isfinite(a) or math.isfinite(b)]
    cut = [math.trunc(end) for end in exact if math.isfinite(end)]  # messages may have whole numbers all the same
    return _within([*exact, *cut], whole=False)


def _shared(one: int, other: int) -> int:
    quotient = abs(one) // abs(other)
    return quotient if (one < 0) == (other < 0) else -quotient


def _left(one: Span, other: Span, part: Node) -> Span:
    """What is left of a division of whole numbers: of the sign of the first, and less than the second."""
    by = max(abs(other.least), abs(other.most), 1)
    limit = by - 1 if other.whole else _UINT[1]
    least = 0 if one.least >= 0 else max(-limit, one.least, WHOLE.least)
    most = 0 if one.most <= 0 else min(limit, one.most, WHOLE.most)
    named = f"what is left of a division by {by}" if isinstance(part, Literal) and most - least < by * 2 else ""
    return Span(math.floor(least), math.ceil(most), whole=True, named=named)


def _magnitude(span: Span) -> Span:
    ends = [abs(span.least), abs(span.most)]
    return _within([*ends, *([0] if span.least <= 0 <= span.most else [])], whole=span.whole)


def _truncated(span: Span, lowest: int, highest: int) -> Span:
    least = lowest if span.least < lowest else math.trunc(span.least)
    most = highest if span.most > highest else math.trunc(span.most)
    return Span(least, most, whole=True) if least <= most else Span(lowest, highest, whole=True)


def _root(span: Span) -> Span:
    return _within((math.sqrt(max(span.least, 0)), math.sqrt(max(span.most, 0))), whole=False)


_MADE: dict[str, Callable[[Span], Span]] = {
    "abs": _magnitude,
    "double": lambda span: _within((span.least, span.most), whole=False),
    "int": lambda span: _truncated(span, *_INT),
    "sqrt": _root,
    "uint": lambda span: _truncated(span, *_UINT),
}
"""What the functions of one number make of it."""
