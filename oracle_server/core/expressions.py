"""CEL expressions over `msg`, guarded: bounded before the library sees them, pruned to the fields that they read.

The library has no time limit and recurses over what it is given, so size, nesting and comprehensions are checked here.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
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
MAX_READ = 100_000
"""Most values that any expression may read, each as often as it is named; 64 characters of a text count as one."""
MAX_WORK = 100_000
"""Most values that a comprehension may come by: those that it goes over, times those that it has for each."""
MAX_COMPREHENSIONS = 8

Path = tuple[str, ...]

_TOKEN = re.compile(
    r"""\s+|//[^\n]*
    |(?P<string>
        (?:[rR][bB]?|[bB][rR])(?:\"\"\".*?\"\"\"|'''.*?'''|"[^"\n]*"|'[^'\n]*')
        |[bB]?(?:\"\"\"(?:\\.|[^\\])*?\"\"\"|'''(?:\\.|[^\\])*?'''|"(?:\\.|[^"\\\n])*"|'(?:\\.|[^'\\\n])*'))
    |(?P<name>[A-Za-z_][A-Za-z0-9_]*)
    |(?P<number>\d[\w.]*)
    |(?P<mark>.)""",
    re.VERBOSE | re.DOTALL,
)
_COMPREHENSIONS = frozenset({"all", "exists", "exists_one", "map", "filter"})
_FUNCTIONS = frozenset({
    "bytes", "contains", "double", "duration", "endsWith", "getDate", "getDayOfMonth", "getDayOfWeek",
    "getDayOfYear", "getFullYear", "getHours", "getMilliseconds", "getMinutes", "getMonth", "getSeconds", "has", "int",
    "matches", "size", "startsWith", "string", "timestamp", "uint",
})  # fmt: skip


@dataclass(frozen=True)
class Expression:
    """A checked expression and the fields of `msg` that it reads, the empty path being the whole message.

    `outer` and `inner` are those outside and inside of comprehensions, each as often as it is named; `uses` is how
    often a comprehension's variable is named inside; `outer_size` and `inner_size` count the text's own tokens.
    """

    text: str
    outer: tuple[Path, ...]
    inner: tuple[Path, ...]
    uses: int
    outer_size: int
    inner_size: int

    @cached_property
    def paths(self) -> tuple[Path, ...]:
        """The fields that are read, each once."""
        return tuple(dict.fromkeys((*self.outer, *self.inner)))

    @cached_property
    def program(self) -> Any:
        """The compiled expression."""
        return _compile(self.text)


def parse_expression(text: str) -> Expression:
    """Check an expression without running it. Raises `ExpressionError`."""
    if len(text) > MAX_TEXT:
        raise ExpressionError(f"the expression has {len(text)} characters; at most {MAX_TEXT} are read")
    tokens = [m for m in _TOKEN.finditer(text) if m.lastgroup]
    bodies = _bodies(tokens)
    variables = {tokens[body.start][0] for body in bodies}
    program = _compile(text)
    unknown_names = set(program.variables()) - {"msg"} - variables
    if unknown_names:
        raise ExpressionError(f"unknown name '{min(unknown_names)}'; an expression reads `msg`, as in msg.field")
    unknown = {name.rsplit(".", 1)[-1] for name in program.functions() if name[:1].isalpha()}
    unknown -= _FUNCTIONS | _COMPREHENSIONS
    if unknown:
        raise ExpressionError(f"unknown function '{min(unknown)}'; known are {', '.join(sorted(_FUNCTIONS))}")
    inside = {i for body in bodies for i in body}
    found = _paths(tokens)
    return Expression(
        text,
        tuple(path for at, path in found if at not in inside),
        tuple(path for at, path in found if at in inside),
        sum(1 for i in inside if tokens[i][0] in variables) - len(bodies),
        len(tokens) - len(inside),
        len(inside),
    )


def check_size(message: Mapping[str, Any], expression: Expression) -> None:
    """Refuse a message of which an expression would read too much. Raises `ExpressionError`."""
    sizes = {path: _size(read(message, path)) for path in expression.paths}
    outer = sum(sizes[path] for path in expression.outer)
    inner = sum(sizes[path] for path in expression.inner)
    if outer + inner > MAX_READ:
        raise ExpressionError(f"the expression reads more than {MAX_READ} values of the message")
    if not expression.inner_size:
        return
    if sum(sizes.values()) > MAX_ELEMENTS:
        raise ExpressionError(f"the message has more than {MAX_ELEMENTS} values for a comprehension to read")
    largest = max((_largest_item(read(message, path)) for path in expression.outer), default=1)
    each = inner + expression.uses * largest + expression.inner_size
    if (outer + expression.outer_size) * each > MAX_WORK:
        raise ExpressionError(f"the comprehension would come by more than {MAX_WORK} values")


def prune(message: Mapping[str, Any], expressions: tuple[Expression, ...]) -> dict[str, Any]:
    """A copy of a message with the fields that the expressions read, and no others."""
    if any(() in e.paths for e in expressions):
        return dict(message)
    pruned: dict[str, Any] = {}
    for path in dict.fromkeys(path for e in expressions for path in e.paths):
        _copy(message, pruned, path)
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


def _bodies(tokens: list[re.Match[str]]) -> list[range]:
    """Where the comprehensions' bodies stand, variable first. Refuses those that could grow, and deep brackets."""
    depth, start, kinds, bodies = 0, None, [], []
    opened = 0
    for i, token in enumerate(tokens):
        mark = token[0]
        if mark in _COMPREHENSIONS and [t[0] for t in tokens[i - 1 : i + 2]] == [".", mark, "("]:
            if start is not None:
                raise ExpressionError(f"'{mark}' stands inside another comprehension; they can't be nested")
            start, opened = i + 2, depth + 1
            kinds.append(mark)
        elif mark in ("(", "[", "{"):
            depth += 1
            if depth > MAX_NESTING:
                raise ExpressionError(f"the expression is nested more than {MAX_NESTING} deep")
        elif mark in (")", "]", "}"):
            if depth == opened and start is not None:
                bodies.append(range(start, i))
                start = None
            depth -= 1
    _check_comprehensions(kinds)
    bodies = [body for body in bodies if len(body)]
    if any(tokens[body.start][0] == "msg" for body in bodies):
        raise ExpressionError("the variable of a comprehension can't be called msg")
    return bodies


def _check_comprehensions(kinds: list[str]) -> None:
    if len(kinds) > MAX_COMPREHENSIONS:
        raise ExpressionError(f"the expression has more than {MAX_COMPREHENSIONS} comprehensions")
    if "map" in kinds and len(kinds) > 1:
        raise ExpressionError("'map' stands beside another comprehension; an expression with `map` has no other")


def _paths(tokens: list[re.Match[str]]) -> list[tuple[int, Path]]:
    """Where an expression reads `msg`, and which field: each `msg` with the `.name` and `["name"]` after it."""
    words = [(t.lastgroup, t[0]) for t in tokens]
    found: list[tuple[int, Path]] = []
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
        found.append((start, tuple(path)))
    return found


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


def _size(value: Any) -> int:
    """How many values there are in a value; 64 characters of a text count as one."""
    count, level = 0, [value]
    for _ in range(MAX_NESTING + 1):
        count += sum(1 + len(v) // 64 if isinstance(v, str) else 1 for v in level)
        level = [inner for outer in level for inner in _items(outer)]
        if not level:
            return count
    raise ExpressionError(f"the message is nested more than {MAX_NESTING} deep")


def _largest_item(value: Any) -> int:
    return max((_size(item) for item in _items(value)), default=1)


def _items(value: Any) -> Iterable[Any]:
    if isinstance(value, Mapping):
        return value.values()
    return value if isinstance(value, list) else ()
