"""CEL expressions over `msg`, guarded: bounded before the library sees them, pruned to the fields that they read.

The library has no time limit and recurses over what it is given, so size, nesting and comprehensions are checked here.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cel

from oracle_server.core.errors import ExpressionError

MAX_TEXT = 4096
"""Longest expression, in characters."""
MAX_NESTING = 64
"""Deepest nesting of brackets in an expression, and of what it reads in a message."""
MAX_ELEMENTS = 4096
"""Most values that an expression with a comprehension may read of one message."""

Path = tuple[str, ...]

_TOKEN = re.compile(
    r"""\s+|//[^\n]*
    |(?P<string>[bBrR]{0,2}(?:\"\"\"(?:\\.|[^\\])*?\"\"\"|'''(?:\\.|[^\\])*?'''|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'))
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<number>\d[\w.]*)
    |(?P<mark>.)""",
    re.VERBOSE | re.DOTALL,
)
_COMPREHENSIONS = frozenset({"all", "exists", "exists_one", "map", "filter"})
_FUNCTIONS = frozenset({
    "bool", "bytes", "contains", "double", "endsWith", "has", "int", "matches", "max", "min", "size", "startsWith",
    "string", "timestamp", "duration", "uint", "getHours", "getMinutes", "getSeconds", "getMilliseconds",
    "getFullYear", "getMonth", "getDate", "getDayOfMonth", "getDayOfWeek", "getDayOfYear",
})  # fmt: skip


@dataclass(frozen=True)
class Expression:
    """A checked expression; `paths` are the fields of `msg` that it reads, the empty path being the whole message."""

    text: str
    paths: tuple[Path, ...]
    comprehends: bool

    @cached_property
    def direct(self) -> Path | None:
        """The path, where the expression is nothing but one: it then needs no CEL."""
        return self._only_path(self.text)

    @cached_property
    def direct_string(self) -> Path | None:
        """The path within `string(path)`, where the expression is nothing but that."""
        inner = re.fullmatch(r"\s*string\s*\((.*)\)\s*", self.text, re.DOTALL)
        return self._only_path(inner[1]) if inner else None

    @cached_property
    def program(self) -> Any:
        """The compiled expression."""
        return _compile(self.text)

    def _only_path(self, text: str) -> Path | None:
        plain = re.fullmatch(r"\s*msg((?:\.[A-Za-z_][A-Za-z0-9_]*)+)\s*", text)
        return tuple(plain[1][1:].split(".")) if plain else None


def parse_expression(text: str) -> Expression:
    """Check an expression without running it. Raises `ExpressionError`."""
    if len(text) > MAX_TEXT:
        raise ExpressionError(f"the expression has {len(text)} characters; at most {MAX_TEXT} are read")
    tokens = [m for m in _TOKEN.finditer(text) if m.lastgroup]
    variables = _check_nesting(tokens)
    program = _compile(text)
    unknown_names = set(program.variables()) - {"msg"} - variables
    if unknown_names:
        raise ExpressionError(f"unknown name '{min(unknown_names)}'; an expression reads `msg`, as in msg.field")
    unknown = {name.rsplit(".", 1)[-1] for name in program.functions() if name[:1].isalpha()}
    unknown -= _FUNCTIONS | _COMPREHENSIONS
    if unknown:
        raise ExpressionError(f"unknown function '{min(unknown)}'; known are {', '.join(sorted(_FUNCTIONS))}")
    return Expression(text, _paths(tokens), comprehends=bool(variables))


def prune(message: Mapping[str, Any], expressions: tuple[Expression, ...]) -> dict[str, Any]:
    """A copy of a message with the fields that the expressions read, and no others.

    Raises `ExpressionError` where what they read is nested too deep, or too large for a comprehension.
    """
    if any(() in e.paths for e in expressions):
        pruned = dict(message)
    else:
        pruned = {}
        for path in dict.fromkeys(path for e in expressions for path in e.paths):
            _copy(message, pruned, path)
    limit = MAX_ELEMENTS if any(e.comprehends for e in expressions) else None
    _check_size(pruned, limit)
    return pruned


def read(message: object, path: Path) -> Any:
    """The value at a path of a message, None where it is missing."""
    for name in path:
        if not isinstance(message, Mapping):
            return None
        message = message.get(name)
    return message


def _compile(text: str) -> Any:
    try:
        return cel.compile(text)
    except Exception as error:  # noqa: BLE001 -- the library raises several types for a malformed text
        reason = str(error).splitlines()[0]
        reason = reason.rsplit("ERROR: <input>:", 1)[-1]
        raise ExpressionError(f"not a CEL expression: {reason}") from None


def _check_nesting(tokens: list[re.Match[str]]) -> set[str]:
    """Refuse deep brackets and nested comprehensions; return the variables of those that are there."""
    variables: set[str] = set()
    depth, within = 0, 0
    for i, token in enumerate(tokens):
        mark = token[0]
        if mark in _COMPREHENSIONS and [t[0] for t in tokens[i - 1 : i + 2]] == [".", mark, "("]:
            if within:
                raise ExpressionError(f"'{mark}' stands inside another comprehension; they can't be nested")
            within = depth + 1
            variables.update(t[0] for t in tokens[i + 2 : i + 3])
        elif mark in ("(", "[", "{"):
            depth += 1
            if depth > MAX_NESTING:
                raise ExpressionError(f"the expression is nested more than {MAX_NESTING} deep")
        elif mark in (")", "]", "}"):
            if depth == within:
                within = 0
            depth -= 1
    if "msg" in variables:
        raise ExpressionError("the variable of a comprehension can't be called msg")
    return variables


def _paths(tokens: list[re.Match[str]]) -> tuple[Path, ...]:
    """The fields of `msg` that an expression reads: each `msg` with the `.name` and `["name"]` after it."""
    words = [(t.lastgroup, t[0]) for t in tokens]
    found: dict[Path, None] = {}
    for start, (kind, word) in enumerate(words):
        if (kind, word) != ("name", "msg") or (start and words[start - 1][1] == "."):
            continue
        path: list[str] = []
        i = start + 1
        while True:
            match words[i : i + 3]:
                case [("mark", "."), ("name", name), *rest] if not (rest and rest[0][1] == "("):
                    path.append(name)
                    i += 2
                case [("mark", "["), ("string", text), ("mark", "]")] if text[0] in "\"'" and "\\" not in text:
                    path.append(text.strip(text[0]))
                    i += 3
                case _:
                    break
        found[tuple(path)] = None
    return tuple(found)


def _copy(source: Any, target: dict[str, Any], path: Path) -> None:
    """Copy one path; where it crosses a list or a scalar, or ends, the value is taken whole."""
    for name in path[:-1]:
        if not isinstance(source, Mapping) or name not in source:
            return
        if not isinstance(source[name], Mapping):
            target[name] = source[name]
            return
        source, inner = source[name], target.get(name)
        if inner is source:
            return
        target = target.setdefault(name, {})
    if isinstance(source, Mapping) and path[-1] in source:
        target[path[-1]] = source[path[-1]]


def _check_size(value: Any, limit: int | None) -> None:
    count, level = 0, [value]
    for _ in range(MAX_NESTING):
        level = [
            inner
            for outer in level
            if isinstance(outer, Mapping | list)
            for inner in (outer.values() if isinstance(outer, Mapping) else outer)
        ]
        count += len(level)
        if not level:
            return
        if limit is not None and count > limit:
            raise ExpressionError(f"the message has more than {limit} values for a comprehension to read")
    raise ExpressionError(f"the message is nested more than {MAX_NESTING} deep")
