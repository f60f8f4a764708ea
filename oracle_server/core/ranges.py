"""What values a signal can have, as far as its expression tells, and whether one of them can meet a constraint."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Literal

from oracle_server.core.atoms import canonical, meets
from oracle_server.core.formula.tree import Constraint, Scalar

ValueKind = Literal["text", "number", "boolean"]


@dataclass(frozen=True, slots=True)
class Range:
    """The values that a signal can have: all of these kinds, and these ones besides, as canonical texts."""

    kinds: frozenset[ValueKind] = frozenset()
    values: tuple[Scalar, ...] = ()

    def __or__(self, other: Range) -> Range:
        """What either can have."""
        values = {canonical(v): v for v in (*self.values, *other.values)}
        return Range(self.kinds | other.kinds, tuple(values.values()))

    def meets(self, constraints: Sequence[Constraint]) -> bool:
        """Whether some value meets all constraints, which are on one signal."""
        return any(all(meets(c, v) for c in constraints) for v in self._telling(constraints))

    def always_meets(self, constraint: Constraint) -> bool:
        """Whether every value meets a constraint."""
        return all(meets(constraint, v) for v in self._telling([constraint]))

    def _telling(self, constraints: Sequence[Constraint]) -> Iterator[Scalar]:
        """Values of which one meets the constraints if any value does, and one fails them if any does."""
        yield from self.values
        wanted = [c.value for c in constraints if isinstance(c.value, str | bool | int | float)]
        if "boolean" in self.kinds:
            yield from (True, False)
        if "text" in self.kinds:
            texts = [w for w in wanted if isinstance(w, str)]
            yield from (*texts, "".join(texts) + "…")
        if "number" in self.kinds:
            yield from _numbers(w for w in wanted if not isinstance(w, str | bool))


ANYTHING = Range(frozenset({"text", "number", "boolean"}))
_TEXT, _NUMBER, _BOOLEAN = (Range(frozenset({kind})) for kind in ("text", "number", "boolean"))

_OF_FUNCTIONS = {
    "string": _TEXT, "double": _NUMBER, "int": _NUMBER, "uint": _NUMBER, "size": _NUMBER, "has": _BOOLEAN,
}  # fmt: skip
_OF_METHODS = dict.fromkeys(("contains", "startsWith", "endsWith", "matches", "exists", "all"), _BOOLEAN)
_RELATIONS = frozenset({"||", "&&", "==", "!=", "<", "<=", ">", ">=", "in"})
_TOKEN = re.compile(
    r"""(?P<text>"[^"\\\n]*"|'[^'\\\n]*')
    |(?P<number>\d+(?:\.\d+)?)(?![\w.])
    |(?P<name>[A-Za-z_]\w*)
    |(?P<mark>\|\||&&|[<>=!]=|[^\s"'])""",
    re.VERBOSE,
)
_Tokens = Sequence[tuple[str, str]]


def range_of(expression: str) -> Range:
    """The values that an expression can give where it gives one; anything where that takes more than a look."""
    tokens, at = [], 0
    text = expression.strip()
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            return ANYTHING
        tokens.append((str(match.lastgroup), match[0]))
        at = match.end()
        at += len(text[at:]) - len(text[at:].lstrip())
    return _range(tokens)


def _range(tokens: _Tokens) -> Range:
    """The range of an expression by its loosest operator; each choice is taken apart without recursion."""
    found = Range()
    while True:
        top = list(_outside_brackets(tokens))
        question = next((i for i in top if tokens[i] == ("mark", "?")), None)
        if question is None:
            return found | _simple(tokens, top)
        colon = _otherwise(tokens, top, question)
        if colon is None:
            return ANYTHING
        then = tokens[question + 1 : colon]
        found |= _simple(then, list(_outside_brackets(then)))
        tokens = tokens[colon + 1 :]


def _otherwise(tokens: _Tokens, top: list[int], question: int) -> int | None:
    """Where the colon of a choice is; None where the choice has another one before it."""
    for i in top:
        if i > question and tokens[i] == ("mark", "?"):
            return None
        if i > question and tokens[i] == ("mark", ":"):
            return i
    return None


def _simple(tokens: _Tokens, top: list[int]) -> Range:  # noqa: PLR0911 -- a case a form
    """The range of an expression that makes no choice at its outermost."""
    words = [tokens[i][1] for i in top]
    if any(tokens[i][0] != "text" and tokens[i][1] in _RELATIONS for i in top):
        return _BOOLEAN
    if len(tokens) == 1:
        return _literal(*tokens[0])
    if [kind for kind, _ in tokens] == ["mark", "number"] and tokens[0][1] == "-":
        return Range(values=(-_value(tokens[1][1]),))
    if words[:1] == ["!"]:
        return _BOOLEAN if words[1:2] != ["!"] else ANYTHING
    if len(words) >= 2 and words[-2:] == ["(", ")"]:
        before = words[:-2]
        if not before:
            return _range(tokens[1:-1])
        if len(before) == 1:
            return _OF_FUNCTIONS.get(before[0], ANYTHING)
        if before[-2] == "." and not set(before) & set("+-*/%"):
            return _OF_METHODS.get(before[-1], ANYTHING)
    return ANYTHING


def _outside_brackets(tokens: _Tokens) -> Iterator[int]:
    """Where the tokens stand that are in no brackets, outermost brackets included."""
    depth = 0
    for i, (kind, word) in enumerate(tokens):
        closes = kind == "mark" and word in ")]}"
        depth -= closes
        if depth == 0:
            yield i
        depth += kind == "mark" and word in "([{"


def _literal(kind: str, word: str) -> Range:
    if kind == "text":
        return Range(values=(word[1:-1],))
    if kind == "number":
        return Range(values=(_value(word),))
    if word == "null":
        return Range()  # the signal is absent
    return Range(values=(word == "true",)) if word in ("true", "false") else ANYTHING


def _value(word: str) -> int | float:
    return float(word) if "." in word else int(word)


def _numbers(wanted: Iterable[float]) -> Iterator[Scalar]:
    """The wanted numbers, one between each two, and one beyond each end."""
    marks = sorted({Fraction(w) for w in wanted}) or [Fraction(0)]
    between = [(low + high) / 2 for low, high in pairwise(marks)]
    yield from (marks[0] - 1, *marks, *between, marks[-1] + 1)  # type: ignore[misc] # fractions compare as numbers do
