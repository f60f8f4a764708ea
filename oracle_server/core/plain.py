"""Plain expressions: choices, comparisons and `string()` over fields and literals, worked out without the CEL library.

Most signals are of this kind, and entering the library costs more than all else that is done with an event. A plain
expression answers only where there can be no doubt: at a value of another kind than it expects, it declines, and the
library is asked. So errors, missing fields, conversions and mixed types mean what CEL says that they mean.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from oracle_server.core.expressions import Path, read

Evaluate = Callable[[Mapping[str, Any]], Any]
"""A message to a value. Raises `Declined`."""

_EXACT = 2**53
"""Integers up to here compare alike with floats, however a library does it."""
_MAX_TOKENS = 100
"""Longest plain expression: it is worked out recursively."""
_OPERATORS: dict[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
    "==": operator.eq,
    "!=": operator.ne,
}
_TOKEN = re.compile(
    r"""\s*(?:
    (?P<mark>&&|\|\||[<>=!]=|[<>?:()!])
    |(?P<number>-?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)(?![A-Za-z0-9_.])
    |(?P<text>"[^"\\\n]*"|'[^'\\\n]*')
    |(?P<path>msg(?:\.[A-Za-z_][A-Za-z0-9_]*)+)(?!\s*[\[(.]|[A-Za-z0-9_])
    |(?P<string>string)(?=\s*\()
    |(?P<truth>true|false)(?![A-Za-z0-9_])
    )\s*""",
    re.VERBOSE,
)


class Declined(Exception):  # noqa: N818 -- no error: the library answers instead
    """A value is not of the kind that the expression expects."""


def plain(text: str) -> Evaluate | None:
    """How to work out an expression that CEL accepts; None where it takes more than is understood here."""
    tokens, at = [], 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            return None
        tokens.append((str(match.lastgroup), match[match.lastgroup or 0]))
        at = match.end()
    if len(tokens) > _MAX_TOKENS:
        return None
    parser = _Parser(tokens)
    try:
        evaluate = parser.choice()
    except _NotPlain:
        return None
    return evaluate if parser.at_end else None


class _NotPlain(Exception):  # noqa: N818 -- caught where it matters
    """The expression takes more than is understood here."""


class _Parser:
    """CEL's grammar, as far as it goes here, from the loosest operator to the tightest."""

    def __init__(self, tokens: list[tuple[str, str]]) -> None:
        self._tokens = [*tokens, ("end", "")]
        self._at = 0

    @property
    def at_end(self) -> bool:
        return self._tokens[self._at][0] == "end"

    def choice(self) -> Evaluate:
        condition = self._either()
        if not self._takes("?"):
            return condition
        then = self._either()
        self._must(":")
        return _choice(condition, then, self.choice())

    def _either(self) -> Evaluate:
        left = self._both()
        return _joined(left, self._either(), decides=True) if self._takes("||") else left

    def _both(self) -> Evaluate:
        left = self._comparison()
        return _joined(left, self._both(), decides=False) if self._takes("&&") else left

    def _comparison(self) -> Evaluate:
        left = self._operand()
        mark = self._tokens[self._at][1]
        if self._tokens[self._at][0] != "mark" or mark not in _OPERATORS:
            return left
        self._at += 1
        return _comparison(mark, left, self._operand())

    def _operand(self) -> Evaluate:
        kind, word = self._tokens[self._at]
        self._at += 1
        if kind == "path":
            return _field(tuple(word.split(".")[1:]))
        if kind == "string":
            return _string(self._operand())
        if kind == "mark":
            return self._marked(word)
        return _Constant(_literal(kind, word))

    def _marked(self, mark: str) -> Evaluate:
        if mark == "!":
            return _negation(self._operand())
        if mark != "(":
            raise _NotPlain
        inside = self.choice()
        self._must(")")
        return inside

    def _takes(self, mark: str) -> bool:
        found = self._tokens[self._at] == ("mark", mark)
        self._at += found
        return found

    def _must(self, mark: str) -> None:
        if not self._takes(mark):
            raise _NotPlain


def _literal(kind: str, word: str) -> float | str:
    if kind == "text":
        return word[1:-1]
    if kind == "truth":
        return word == "true"
    if kind != "number":
        raise _NotPlain
    value = float(word) if "." in word or "e" in word.lower() else int(word)
    if not math.isfinite(value) or abs(value) > _EXACT:
        raise _NotPlain
    return value


def _field(path: Path) -> Evaluate:
    if len(path) > 1:
        return lambda message: read(message, path)
    (name,) = path
    return lambda message: message.get(name)


@dataclass(frozen=True, slots=True)
class _Constant:
    value: float | str

    def __call__(self, _: Mapping[str, Any]) -> float | str:
        return self.value


def _choice(condition: Evaluate, then: Evaluate, otherwise: Evaluate) -> Evaluate:
    def evaluate(message: Mapping[str, Any]) -> Any:
        holds = condition(message)
        if holds is True:
            return then(message)
        if holds is False:
            return otherwise(message)
        raise Declined

    return evaluate


def _joined(left: Evaluate, right: Evaluate, *, decides: bool) -> Evaluate:
    """`||`, which a true operand decides, or `&&`, which a false one does."""

    def evaluate(message: Mapping[str, Any]) -> bool:
        first = _truth(left(message))
        return first if first is decides else _truth(right(message))

    return evaluate


def _negation(inside: Evaluate) -> Evaluate:
    return lambda message: not _truth(inside(message))


def _string(inside: Evaluate) -> Evaluate:
    def evaluate(message: Mapping[str, Any]) -> str:
        value = inside(message)
        if type(value) is str:
            return value
        if type(value) is int and -_EXACT <= value <= _EXACT:
            return str(value)
        raise Declined

    return evaluate


def _comparison(mark: str, left: Evaluate, right: Evaluate) -> Evaluate:
    holds, alike = _OPERATORS[mark], mark in ("==", "!=")
    if isinstance(right, _Constant) and not isinstance(right.value, str | bool):
        return _comparison_with(holds, left, right.value)

    def evaluate(message: Mapping[str, Any]) -> bool:
        one, other = left(message), right(message)
        kind = _kind(one)
        if kind != _kind(other) or (kind is bool and not alike):
            raise Declined
        return holds(one, other)

    return evaluate


def _comparison_with(holds: Callable[[Any, Any], bool], left: Evaluate, number: float) -> Evaluate:
    """The common case: a field and a number that is written out."""

    def evaluate(message: Mapping[str, Any]) -> bool:
        value = left(message)
        if _kind(value) is float:
            return holds(value, number)
        raise Declined

    return evaluate


def _truth(value: Any) -> bool:
    if value is True or value is False:
        return value
    raise Declined


def _kind(value: Any) -> type:
    """The kind of a scalar that compares without doubt: `float` for all numbers."""
    kind = type(value)
    if kind is float and math.isfinite(value):
        return float
    if kind is int and -_EXACT <= value <= _EXACT:
        return float
    if kind is bool or (kind is str and value.isascii()):
        return kind
    raise Declined
