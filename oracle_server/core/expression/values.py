"""What operators and functions make of values: arithmetic, equality, order and conversions.

Whole numbers are of 64 bits, signed or not; real ones of 64 bits. A null among the operands is a field without value.
A real one that is not finite arrives as a text, which counts as that number wherever a number can stand.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence
from decimal import Decimal
from typing import Any

from oracle_server.core.expression.cost import MAX_NESTING, Frame, charge
from oracle_server.core.expression.stops import Absent, Failed

_LEAST, _MOST, _UNSIGNED = -(2**63), 2**63, 2**64
_REAL = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:e[+-]?[0-9]+)?|inf|infinity|nan)", re.IGNORECASE | re.ASCII)
"""A text that `float()` reads: without ASCII, IGNORECASE takes dotless and dotted I of Turkish for `i`."""
_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")
NOT_FINITE = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
NO_ORDER = "NaN is neither less nor more than any number; ask for `!= 'NaN'` first"
_LONGEST_NUMBER = 400
"""Most characters of a text that is read as a number."""


def unfit(why: str, *operands: Any) -> Absent | Failed:
    """What ends the evaluation of operands that do not fit: a null makes the value absent, all else fails."""
    return Absent() if any(o is None for o in operands) else Failed(why, *operands)


def whole(result: int, one: int, other: int, mark: str) -> int:
    """A result within the 64 bits of its operands."""
    if _LEAST <= result < _MOST or (_MOST <= result < _UNSIGNED and (one >= _MOST or other >= _MOST)):
        return result
    raise Failed(f"`{mark}` gives more than 64 bits", one, other)


def real(value: float) -> float:
    """A number as a real one."""
    try:
        return float(value)
    except OverflowError:
        raise Failed("the number has more than 64 bits", value) from None


def number(value: Any) -> Any:
    """A value as it is, but a text that stands for a number which is not finite as that number."""
    return NOT_FINITE.get(value, value) if type(value) is str else value


def _reals(why: str, one: Any, other: Any) -> tuple[float, float]:
    """Two numbers as real ones. Raises `Stopped`."""
    first, second = number(one), number(other)
    if is_number(first) and is_number(second):
        return real(first), real(second)
    raise unfit(why, one, other)


def add(one: Any, other: Any, frame: Frame) -> Any:
    """Numbers, texts, or lists."""
    kind = type(one)
    if kind is type(other):
        if kind is float:
            return one + other
        if kind is int:
            return whole(one + other, one, other, "+")
        if kind is str and not (one in NOT_FINITE and other in NOT_FINITE):
            charge(frame, (len(one) + len(other)) >> 6)
            return one + other
        if kind is list:
            charge(frame, (len(one) + len(other)) >> 2)
            return one + other
    first, second = _reals("`+` takes two numbers, two texts or two lists", one, other)
    return first + second


def subtract(one: Any, other: Any, _frame: Frame) -> Any:
    """The difference of two numbers."""
    kind = type(one)
    if kind is type(other):
        if kind is float:
            return one - other
        if kind is int:
            return whole(one - other, one, other, "-")
    first, second = _reals("`-` takes numbers", one, other)
    return first - second


def multiply(one: Any, other: Any, _frame: Frame) -> Any:
    """The product of two numbers."""
    kind = type(one)
    if kind is type(other):
        if kind is float:
            return one * other
        if kind is int:
            return whole(one * other, one, other, "*")
    first, second = _reals("`*` takes numbers", one, other)
    return first * second


def divide(one: Any, other: Any, _frame: Frame) -> Any:
    """The quotient of two numbers: of whole ones whole, towards zero."""
    if type(one) is int and type(other) is int:
        if other == 0:
            raise Failed("division by zero", one, other)
        quotient = abs(one) // abs(other)
        return whole(quotient if (one < 0) == (other < 0) else -quotient, one, other, "/")
    one, other = _reals("`/` takes numbers", one, other)
    if other:
        return one / other
    return math.nan if one == 0 or math.isnan(one) else math.copysign(math.inf, one) * math.copysign(1.0, other)


def remainder(one: Any, other: Any, _frame: Frame) -> int:
    """What is left of a division of whole numbers, with the sign of the first."""
    if type(one) is not int or type(other) is not int:
        raise unfit("`%` takes whole numbers", one, other)
    if other == 0:
        raise Failed("division by zero", one, other)
    left = abs(one) % abs(other)
    return -left if one < 0 else left


ARITHMETIC: dict[str, Callable[[Any, Any, Frame], Any]] = {
    "+": add,
    "-": subtract,
    "*": multiply,
    "/": divide,
    "%": remainder,
}


def is_number(value: Any) -> bool:
    """Whether a value is a number, which `true` is not."""
    return type(value) is float or type(value) is int


def minus(value: Any) -> Any:
    """A number with the other sign."""
    if type(value) is int:
        return whole(-value, value, 0, "-")
    found = number(value)
    if type(found) is float:
        return -found
    raise unfit("`-` takes a number", value)


def same(one: Any, other: Any, frame: Frame, depth: int = 0) -> bool:
    """Whether two values are equal: 7 and 7.0 are, 7 and '7' are not, and null is equal to null alone."""
    kind, against = type(one), type(other)
    if kind is str and against is str:
        charge(frame, min(len(one), len(other)) >> 8)
        return bool(one == other)
    if kind in (list, dict) and kind is against:
        if depth == MAX_NESTING:
            raise Failed("the values that are compared are nested too deep", one, other)
        if len(one) != len(other):
            return False
        charge(frame, (3 if kind is list else 4) * len(one))
        return _same_within(one, other, frame, depth + 1)
    if is_number(one) and is_number(other):
        return bool(one == other)
    if (kind is str and against is float) or (kind is float and against is str):
        return bool(number(one) == number(other))
    return (kind is bool or one is None) and one is other


def _same_within(one: Any, other: Any, frame: Frame, depth: int) -> bool:
    """Whether two lists, or two maps, have the same elements: numbers, which most are, are compared at once."""
    for key, value in enumerate(one) if type(one) is list else one.items():
        if type(one) is dict and key not in other:
            return False
        against = other[key]
        if type(value) is type(against) and type(value) in (int, float):
            if value != against:
                return False
        elif not same(value, against, frame, depth):
            return False
    return True


def contained(one: Any, other: Any, frame: Frame) -> bool:
    """Whether a value is an element of a list, or a text the name of a field."""
    if type(other) is list:
        if type(one) is str and one not in NOT_FINITE:
            charge(frame, len(other) * (1 + (len(one) >> 8)) >> 2)
            return one in other
        charge(frame, 3 * len(other))
        return any(same(one, element, frame) for element in other)
    if type(other) is dict and type(one) is str:
        charge(frame, len(one) >> 6)
        return one in other
    if other is None:
        raise Absent
    raise Failed("`in` takes a list behind it", one, other)


ORDER: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


def ordered(mark: str) -> Callable[[Any, Any, Frame], bool]:
    """The comparison of two numbers, two texts or two Booleans. NaN has no place in any order."""
    compare = ORDER[mark]

    def in_order(one: Any, other: Any, frame: Frame) -> bool:
        if type(one) is str and type(other) is str and not (one in NOT_FINITE and other in NOT_FINITE):
            charge(frame, min(len(one), len(other)) >> 8)
            return compare(one, other)
        if type(one) is bool and type(other) is bool:
            return compare(one, other)
        first, second = number(one), number(other)
        if not (is_number(first) and is_number(second)):
            raise unfit(f"`{mark}` takes two numbers or two texts", one, other)
        if first != first or second != second:  # noqa: PLR0124 -- NaN
            raise Failed(NO_ORDER, one, other)
        return compare(first, second)

    return in_order


def shown(value: Any) -> str:
    """A text or a number as a text, in digits however large it is."""
    if type(value) is str:
        return value
    if type(value) is int and _LEAST <= value < _UNSIGNED:
        return str(value)
    if type(value) is not float:
        raise unfit("`string` takes a number or a text", value)
    if not math.isfinite(value):
        return "NaN" if math.isnan(value) else str(value)
    return format(Decimal(repr(value)), "f").removesuffix(".0")


def to_real(value: Any) -> float:
    """A number, or a text that is one, as a real number."""
    if type(value) is float:
        return value
    if type(value) is int:
        return real(value)
    if type(value) is str and len(value) <= _LONGEST_NUMBER and _REAL.fullmatch(value):
        return float(value)
    raise unfit("`double` takes a number, or a text that is one", value)


def to_whole(value: Any) -> int:
    """A number without what is behind its point, or a text that is a whole number, as a signed whole number."""
    return _integer("int", value, _LEAST, _MOST)


def to_unsigned(value: Any) -> int:
    """As `to_whole`, of numbers that are not negative."""
    return _integer("uint", value, 0, _UNSIGNED)


def _integer(name: str, value: Any, least: int, most: int) -> int:
    kind = type(value)
    if kind is int or (kind is float and math.isfinite(value)) or (kind is str and _WHOLE.fullmatch(value)):
        number = int(value)
        # the real number next to the largest whole one is one more, and is left out on either side
        if least <= number < most and (kind is not float or least == 0 or value > least):
            return number
        raise Failed(f"`{name}` gives a number of 64 bits{' that is not negative' if least == 0 else ''}", value)
    raise unfit(f"`{name}` takes a number, or a text that is a whole one", value)


def absolute(value: Any) -> Any:
    """A number without its sign."""
    if type(value) is int:
        return whole(abs(value), value, 0, "abs")
    found = number(value)
    if type(found) is float:
        return abs(found)
    raise unfit("`abs` takes a number", value)


def root(value: Any) -> float:
    """The square root of a number that is not negative."""
    found = number(value)
    if not is_number(found):
        raise unfit("`sqrt` takes a number", value)
    if found < 0:
        raise Failed("a negative number has no square root", value)
    return math.sqrt(real(found))


def largest(values: Sequence[Any]) -> Any:
    """The largest of some numbers, real where one of them is."""
    return _picked(max, values, "max")


def smallest(values: Sequence[Any]) -> Any:
    """The smallest of some numbers, real where one of them is."""
    return _picked(min, values, "min")


def _picked(pick: Callable[[Sequence[Any]], Any], values: Sequence[Any], name: str) -> Any:
    if not values:
        raise Failed(f"`{name}` takes a list with numbers in it, and this one is empty")
    numbers = [number(value) for value in values]
    for value in numbers:
        if not is_number(value):
            raise unfit(f"`{name}` takes numbers", value)
        if value != value:  # noqa: PLR0124 -- NaN
            raise Failed(NO_ORDER, value)
    found = pick(numbers)
    return real(found) if any(type(value) is float for value in numbers) else found


def size(value: Any) -> int:
    """The characters of a text, or the elements of a list."""
    if type(value) is str or type(value) is list or type(value) is dict:
        return len(value)
    raise unfit("`size` takes a text or a list", value)
