"""Conditions that come to the same whatever a part of the message is, since what they ask of it does not go together.

One part is looked at at a time, by values of every kind that its comparisons can tell apart. What is asked of the
others may hold or not, so that what is found is certain, and not all is found.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor, inf, isfinite
from typing import Any, Final

from oracle_server.core.expression.spans import Span, Spans
from oracle_server.core.expression.static import Static, kind
from oracle_server.core.expression.tree import (
    Call,
    Choice,
    Compare,
    Joined,
    Key,
    ListOf,
    Literal,
    Node,
    Unary,
    key_of,
    walk,
)
from oracle_server.core.expression.values import NOT_FINITE, ORDER

Outcomes = frozenset[bool]
"""What a condition may come to; none where it fails, or is absent."""
Snippet = Callable[[Node], str]
"""The text of a part."""

_EITHER: Final = frozenset({True, False})
_NEITHER: Final[Outcomes] = frozenset()
_MOST: Final = 20_000
"""How many nodes are looked at for one expression: beyond, nothing is found."""
_NUMBER_LIKE: Final = tuple(NOT_FINITE)


class Joint:
    """What can be said of the conditions of one expression, within a bound."""

    def __init__(self, spans: Spans) -> None:
        self._spans, self._left = spans, _MOST
        self._keys: dict[int, Key] = {}
        """Of parts that were looked at, by their identity."""

    def told(self, node: Joined, snippet: Snippet) -> str | None:
        """What is said of joined parts that come to the same wherever they come to anything."""
        for key, operand, values in ((None, None, [None]), *self._operands((node,))):
            found = self._all(node, key, values)
            ends = operand is not None and found == {node.mark == "&&"}  # of an interval that has all values
            if len(found) == 1 and not ends and self._left >= 0:
                mend = "`||` where one of them is enough" if node.mark == "&&" else "`&&` where all of them are asked"
                never = f"never {'false' if True in found else 'true'}"
                whatever = "the message is" if operand is None else f"`{snippet(operand)}` is; write {mend}"
                return f"`{snippet(node)}` is {never}, whatever {whatever}"
        return None

    def unreached(self, node: Choice, snippet: Snippet) -> Iterator[tuple[Node, str]]:
        """The tests of a choice that never decide it, since one before them does, and what is said of each."""
        tests = [test for test, _ in node.cases]
        for i in range(1, len(tests)):
            for key, operand, values in self._operands(tests[: i + 1]):
                if all(not self._reached(tests[:i], tests[i], key, value) for value in values) and self._left >= 0:
                    why = f"whatever `{snippet(operand)}` is, one before it holds where it does"
                    yield tests[i], f"`{snippet(tests[i])}` never decides: {why}; write it before that one"
                    break

    def _all(self, node: Node, key: Key, values: Sequence[Any]) -> set[bool]:
        """What a condition may come to for any of an operand's values; not all of it where it is both."""
        found = set[bool]()
        for value in values:
            found |= self._of(node, key, value)
            if len(found) > 1:
                break
        return found

    def _reached(self, before: Sequence[Node], test: Node, key: Key, value: Any) -> bool:
        return True in self._of(test, key, value) and all(False in self._of(each, key, value) for each in before)

    def _operands(self, nodes: Sequence[Node]) -> Iterator[tuple[Key, Node, list[Any]]]:
        """What is asked of more than once, and values of it: of each that the comparisons tell apart at least one."""
        asked: dict[Key, list[tuple[Node, tuple[Any, ...]]]] = {}
        for node in nodes:
            for operand, literals in _asked(node):
                asked.setdefault(self._key(operand), []).append((operand, literals))
        for key, found in asked.items():
            if len(found) > 1 and self._left >= 0:
                operand = found[0][0]
                compared = [value for _, literals in found for value in literals]
                yield key, operand, _values(self._spans.known(operand), self._spans.of(operand), compared)

    def _of(self, node: Node, key: Key, value: Any) -> Outcomes:
        """What a condition may come to where an operand has a value."""
        self._left -= 1
        if self._left < 0:
            return _EITHER
        match node:
            case Joined(mark, parts):
                found = [self._of(part, key, value) for part in parts]
                return _joined(found, decides=mark == "||")
            case Unary("!", of):
                return frozenset(not outcome for outcome in self._of(of, key, value))
            case Compare():
                operand, literals = _compared(node)
                return _compare(node, value) if literals and self._key(operand) == key else _EITHER
        return _alone(node, value, asked=self._key(node) == key)

    def _key(self, node: Node) -> Key:
        if id(node) not in self._keys:
            self._keys[id(node)] = key_of(node)
        return self._keys[id(node)]


def _alone(node: Node, value: Any, *, asked: bool) -> Outcomes:
    """What a part may come to that is a condition by itself, where it is what is asked of or is not."""
    if isinstance(node, Literal) and isinstance(node.value, bool):
        return frozenset({node.value})
    if not asked:
        return _EITHER
    return frozenset({value}) if isinstance(value, bool) else _NEITHER


def _joined(found: Sequence[Outcomes], *, decides: bool) -> Outcomes:
    """What parts may come to together, of which one decides where it is so."""
    some = any(decides in outcomes for outcomes in found)
    every = all((not decides) in outcomes for outcomes in found)
    return frozenset({decides} if some else ()) | frozenset({not decides} if every else ())


def _asked(node: Node) -> Iterator[tuple[Node, tuple[Any, ...]]]:
    """The operands that a condition asks of by themselves, each with the values that it is compared with."""
    match node:
        case Joined(parts=parts):
            for part in parts:
                yield from _asked(part)
        case Unary("!", of):
            yield from _asked(of)
        case Compare():
            operand, literals = _compared(node)
            if literals:
                yield operand, literals
        case Literal() | Choice():
            return
        case _ if not any(isinstance(part, Call) and part.name in ("todo", "unknown") for part in walk(node)):
            yield node, (True,)


def _compared(node: Compare) -> tuple[Node, tuple[Any, ...]]:
    """What a comparison with written-out values is of, and these; none of one that is none, or orders texts."""
    if node.mark == "in":
        items = node.right.items if isinstance(node.right, ListOf) else ()
        values = tuple(item.value for item in items if isinstance(item, Literal))
        return node.left, values if len(values) == len(items) else ()
    operand, literal = (node.right, node.left) if isinstance(node.left, Literal) else (node.left, node.right)
    if not isinstance(literal, Literal) or (node.mark in ORDER and not _number(literal.value)):
        return operand, ()
    return operand, (literal.value,)


def _compare(node: Compare, value: Any) -> Outcomes:
    """What a comparison with written-out values comes to where its operand has a value."""
    if node.mark == "in":
        return frozenset({any(_equal(value, wanted) for wanted in _compared(node)[1])})
    (wanted,) = _compared(node)[1]
    if node.mark in ("==", "!="):
        return frozenset({_equal(value, wanted) is (node.mark == "==")})
    if not _number(value) and value not in ("Infinity", "-Infinity"):
        return _NEITHER
    number = value if _number(value) else {"Infinity": inf, "-Infinity": -inf}[value]
    sides = (wanted, number) if isinstance(node.left, Literal) else (number, wanted)
    return frozenset({bool(ORDER[node.mark](*sides))})


def _beyond(text: str, span: Span) -> bool:
    """Whether an infinity, as a text, is beyond the numbers of a span."""
    return (text == "Infinity" and isfinite(span.most)) or (text == "-Infinity" and isfinite(span.least))


def _equal(value: Any, wanted: Any) -> bool:
    if _number(value) and _number(wanted):
        return bool(value == wanted)
    return type(value) is type(wanted) and bool(value == wanted)


def _number(value: Any) -> bool:
    return isinstance(value, int | float | Fraction) and not isinstance(value, bool)


def _values(static: Static, span: Span | None, literals: Sequence[Any]) -> list[Any]:
    """Values of an operand, as far as its kind is known: those that it is compared with, between them, and beyond."""
    ends = () if span is None else (span.least, span.most)
    numbers = sorted({Fraction(v) for v in (*literals, *ends) if _number(v) and isfinite(v)})
    if kind(static) == "whole":
        made = [Fraction(n) for v in numbers for n in (floor(v) - 1, floor(v), ceil(v), ceil(v) + 1)]
    else:
        between = [(a + b) / 2 for a, b in pairwise(numbers)]
        made = [*numbers, *between, *([numbers[0] - 1, numbers[-1] + 1] if numbers else [Fraction(0)])]
    if span is not None:
        made = [number for number in made if span.least <= number <= span.most]
        odd = [] if span.whole else [text for text in NOT_FINITE if not _beyond(text, span)]
        return [*(made or [Fraction(0)]), *odd]
    texts = {v for v in literals if isinstance(v, str)}
    new = "x" * (1 + max(map(len, texts), default=0))
    if kind(static) == "bool":
        return [True, False]
    found = [*sorted(texts), new, *_NUMBER_LIKE]
    return found if kind(static) in ("text", "bytes") else [True, False, *made, *found, None]
