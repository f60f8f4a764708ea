"""What values a signal can have, as far as its expression and its message's type tell, and what they can meet."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Literal

from oracle_server.core.atoms import canonical, meets
from oracle_server.core.errors import ExpressionError
from oracle_server.core.expression import Literal as Written
from oracle_server.core.expression import Span, parse_expression, results
from oracle_server.core.formula.tree import Any as AnyValue
from oracle_server.core.formula.tree import Constraint, Limit, Ref, Scalar, Signal
from oracle_server.core.shapes import UNIT, WHOLE_NUMBERS, Record, Value
from oracle_server.core.signals import is_signal

ValueKind = Literal["text", "number", "boolean"]
_INTEGERS = (-(2**63), 2**64 - 1)
_ALL = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True)
class Range:
    """The values that a signal can have: all of these kinds, and these ones besides, as canonical texts.

    `whole` are the least and the largest of whole numbers, all of which it can have, too. `limits`: of all numbers
    only those between these two, which are within.
    """

    kinds: frozenset[ValueKind] = frozenset()
    values: tuple[Scalar, ...] = ()
    whole: tuple[int, int] | None = None
    limits: tuple[float, float] = _ALL

    def __or__(self, other: Range) -> Range:
        """What either can have, and no whole number beyond both."""
        values = {canonical(v): v for v in (*self.values, *other.values)}
        ends = [end for found in (self.whole, other.whole) if found for end in found]
        whole = (min(ends), max(ends)) if ends else None
        limits = [found.limits for found in (self, other) if "number" in found.kinds] or [_ALL]
        hull = min(least for least, _ in limits), max(most for _, most in limits)
        return Range(self.kinds | other.kinds, tuple(values.values()), whole, hull)

    @property
    def identity(self) -> tuple[object, ...]:
        """Equal for equal ranges alone: Python takes 1 and True for the same."""
        return self.kinds, tuple(canonical(v) for v in self.values), self.whole, self.limits

    @property
    def has_numbers(self) -> bool:
        """Whether any value is a number."""
        written = any(not isinstance(value, str | bool) for value in self.values)
        return written or "number" in self.kinds or self.whole is not None

    @property
    def numbers(self) -> Range:
        """What of it is a number."""
        values = tuple(value for value in self.values if not isinstance(value, str | bool))
        return Range(self.kinds & {"number"}, values, self.whole, self.limits)

    @property
    def is_number(self) -> bool:
        """Whether every value is a number."""
        return self.kinds <= {"number"} and not any(isinstance(value, str | bool) for value in self.values)

    def meets(self, constraints: Sequence[Constraint]) -> bool:
        """Whether some value meets all constraints, which are on one signal."""
        excluded = {_key(c.value) for c in constraints if c.op == "!=" and isinstance(c.value, str | int | float)}
        few = _fewest(constraints)
        return any(_key(v) not in excluded and all(meets(c, v) for c in few) for v in self.telling(constraints))

    def always_meets(self, constraint: Constraint) -> bool:
        """Whether every value meets a constraint; not known of one that compares with a signal or variable."""
        return not isinstance(constraint.value, Signal | Limit) and all(
            meets(constraint, v) for v in self.telling([constraint])
        )

    def overlaps(self, other: Range) -> bool:
        """Whether some value is in both."""
        one, two = ([Constraint("", "==", v) for v in found.values] for found in (self, other))
        if self.kinds & other.kinds or any(self.meets([c]) for c in two) or any(other.meets([c]) for c in one):
            return True
        if self.whole is None or other.whole is None:
            return bool((self.whole and "number" in other.kinds) or (other.whole and "number" in self.kinds))
        return self.whole[0] <= other.whole[1] and other.whole[0] <= self.whole[1]

    def telling(self, constraints: Sequence[Constraint]) -> Iterator[Scalar]:
        """Values among which there is one for each way in which any value meets some constraints, and fails others."""
        yield from filter(is_signal, self.values)
        wanted = [c.value for c in constraints if isinstance(c.value, str | bool | int | float)]
        if "boolean" in self.kinds:
            yield from (True, False)
        if "text" in self.kinds:
            texts = [w for w in wanted if isinstance(w, str)]
            yield from (*filter(is_signal, texts), "".join(texts) + "…")
        numbers = [w for w in wanted if not isinstance(w, str | bool)]
        if "number" in self.kinds:
            yield from _numbers(numbers, self.limits)
        if self.whole is not None:
            least, most = self.whole
            near = {whole + more for w in numbers for whole in (math.floor(w), math.ceil(w)) for more in (-1, 0, 1)}
            yield from sorted({least, most, *(n for n in near if least <= n <= most)})


ANYTHING = Range(frozenset({"text", "number", "boolean"}))
TEXT, NUMBER, BOOLEAN = (Range(frozenset({kind})) for kind in ("text", "number", "boolean"))
POSITIVE = Range(frozenset({"number"}), limits=(0, math.inf))
"""Any number that is not negative."""


def range_of(text: str, shape: Record | None = None, each: str | None = None) -> Range:
    """The values that an expression can give where it gives one, over messages of a shape or of any.

    `each` is the list of which it reads the elements, if it does.
    """
    try:
        expression = parse_expression(text, each=None if each is None else parse_expression(each))
    except ExpressionError:  # found elsewhere
        return ANYTHING
    found = Range()
    for result in results(expression, shape):
        if isinstance(result, Written):
            found |= Range() if result.value is None else Range(values=(result.value,))
        elif isinstance(result, Span):
            found |= range_of_numbers(result)
        else:
            found |= range_of_field(result)
    return found


def range_of_numbers(span: Span) -> Range:
    """The numbers of a span."""
    if span.least == span.most:
        return Range(values=(span.least,))
    if span.whole:
        return Range(whole=(int(span.least), int(span.most)))
    return Range(frozenset({"number"}), limits=(span.least, span.most))


def range_of_field(value: Value | None) -> Range:
    """The values of a field, or those that an expression computes; anything where nothing is known of it."""
    if value is None:
        return ANYTHING
    match value.kind:
        case "bool":
            return BOOLEAN
        case "real":
            return Range(frozenset({"number"}), limits=UNIT) if value.unit else NUMBER
        case "whole":
            return Range(whole=WHOLE_NUMBERS.get(value.type, _INTEGERS))
        case _:
            return TEXT


def _numbers(wanted: Iterable[float], limits: tuple[float, float]) -> Iterator[Scalar]:
    """The wanted numbers, one between each two, and one beyond each end, as far as they are within limits."""
    least, most = limits
    marks = sorted({Fraction(w) for w in (*wanted, *filter(math.isfinite, limits))}) or [Fraction(0)]
    between = [(low + high) / 2 for low, high in pairwise(marks)]
    found = (marks[0] - 1, *marks, *between, marks[-1] + 1)
    yield from (n for n in found if least <= n <= most)  # type: ignore[misc] # fractions compare as numbers do


def _key(value: Scalar) -> tuple[str, Scalar]:
    """Equal for equal values alone: Python takes 1 and True for the same."""
    return "text" if isinstance(value, str) else "boolean" if isinstance(value, bool) else "number", value


def _fewest(constraints: Sequence[Constraint]) -> list[Constraint]:
    """What is left of constraints on one signal without those that others of them imply, and those with `!=`.

    An atom may have thousands, of which each value that is tried would be asked.
    """
    bounds: dict[str, Constraint] = {}
    others: dict[object, Constraint] = {}
    for c in constraints:
        if isinstance(c.value, AnyValue | Ref) or (c.op == "!=" and isinstance(c.value, str | int | float)):
            continue
        if isinstance(c.value, Signal | Limit):
            others["compared"] = c
        elif c.op == "==" or isinstance(c.value, str | bool):
            others[c.op, _key(c.value)] = c
        else:
            known = bounds.get(c.op[0])
            if known is None or _narrower(c, known):
                bounds[c.op[0]] = c
    return [*bounds.values(), *others.values()]


def _narrower(one: Constraint, other: Constraint) -> bool:
    """Whether a bound, of two on the same side, leaves fewer numbers."""
    if one.value == other.value:
        return len(one.op) == 1
    return bool(one.value > other.value) is (one.op[0] == ">")  # type: ignore[operator] # both are numbers
