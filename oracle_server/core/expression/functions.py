"""The functions of expressions by name: how they are called, what they take, and what they are called elsewhere."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from oracle_server.core.expression.values import (
    absolute,
    largest,
    root,
    shown,
    size,
    smallest,
    to_real,
    to_unsigned,
    to_whole,
)
from oracle_server.core.nearest import nearest


@dataclass(frozen=True, slots=True)
class Function:
    """One function: `usage` shows how it is called; `own` ones stand behind the value, `least` counts arguments."""

    usage: str
    own: bool = False
    least: int = 1
    most: int = 1


FUNCTIONS = {
    "abs": Function("abs(msg.x)"),
    "contains": Function("msg.text.contains('part')", own=True, least=2, most=2),
    "double": Function("double(msg.count)"),
    "endsWith": Function("msg.text.endsWith('end')", own=True, least=2, most=2),
    "int": Function("int(msg.x)"),
    "matches": Function("msg.text.matches('pattern')", own=True, least=2, most=2),
    "lower": Function("msg.text.lower()", own=True),
    "max": Function("max(msg.a, msg.b)", most=64),
    "min": Function("min(msg.a, msg.b)", most=64),
    "size": Function("size(msg.list)"),
    "sqrt": Function("sqrt(msg.x)"),
    "startsWith": Function("msg.text.startsWith('start')", own=True, least=2, most=2),
    "string": Function("string(msg.id)"),
    "todo": Function("todo()", least=0, most=0),
    "trim": Function("msg.text.trim()", own=True),
    "uint": Function("uint(msg.x)"),
    "unknown": Function("unknown()", least=0, most=0),
    "upper": Function("msg.text.upper()", own=True),
}
NUMBERS = frozenset({"abs", "double", "int", "max", "min", "size", "sqrt", "uint"})
"""The functions that give numbers."""
LOOPS = frozenset({"all", "exists", "exists_one", "filter", "map"})
MODULES = frozenset({"math", "Math", "np", "numpy", "std", "cmath"})
"""Where other languages have their functions."""
KNOWN = frozenset({*FUNCTIONS, *LOOPS, "has"})

ONE = {
    "abs": absolute,
    "double": to_real,
    "int": to_whole,
    "size": size,
    "sqrt": root,
    "string": shown,
    "uint": to_unsigned,
}
"""What the functions of one argument do."""
OF_TEXT: dict[str, Callable[[str], str]] = {"lower": str.lower, "trim": str.strip, "upper": str.upper}
"""What the functions behind a text make of it."""
VALUELESS = {"todo": "it is still to be written", "unknown": "it is said to be unknown"}
"""The functions that never give a value, and why."""
OF_NUMBERS = {"max": largest, "min": smallest}
"""What the functions of any number of arguments do with their list."""

_LIST = "write `msg.list.{}(x, x > 0)`"
_NO_TIMES = (
    "expressions have no times and durations; compare the numbers, as in "
    "msg.header.stamp.sec + msg.header.stamp.nanosec / 1e9"
)
_NO_BYTES = "expressions have no bytes; in a message they are a text in base64"
_NO_SUCH = "there is none in expressions: let a node compute it, and observe the topic that has the result"
_BY_NAME = (
    "of lists side by side, as in JointState, the stream has `each: msg.name`: in its signals `item` is each name, and "
    "`msg.position[index]` what stands beside it; of a list of messages ask `msg.list.exists(x, x.name == 'a' && x.ok)`"
)
_FOUND = "write `msg.list.exists(x, x.name == 'a' && x.x > 0)`, or `msg.list.filter(x, x.name == 'a')[0].x`"
_NO_ANGLES = (
    "of a quaternion q, 1 - 2 * (q.x * q.x + q.y * q.y) is the cosine of the tilt, 2 * (q.w * q.z + q.x * q.y) and "
    "1 - 2 * (q.y * q.y + q.z * q.z) sine and cosine of the heading"
)
_TEXTS = "parts of a text are asked for by `msg.text.startsWith('a')`, `contains`, `endsWith` and `matches`"
_NOT_A_NUMBER = "NaN arrives as a text: write `msg.x == 'NaN'`"
_ONE_MESSAGE = "an expression reads one message alone; what was before is asked in a formula, by `pre` or `once`"
_ELSEWHERE = {
    **dict.fromkeys(
        ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "exp", "log", "log10", "ln", "cbrt", "sum", "mean"),
        _NO_SUCH,
    ),
    **dict.fromkeys(
        ("now", "time"), "an expression reads the message alone; a formula's bounds count time, as `once[:2s]`"
    ),
    **dict.fromkeys(("index", "indexOf", "index_of", "argmax", "zip", "enumerate", "range"), _BY_NAME),
    **dict.fromkeys(("find", "first", "findFirst", "next"), _FOUND),
    **dict.fromkeys(("at", "nth"), "write `msg.list[0]`"),
    **dict.fromkeys(("isNaN", "is_nan"), _NOT_A_NUMBER),
    **dict.fromkeys(("isFinite", "isfinite", "is_finite"), f"{_NOT_A_NUMBER}, 'Infinity' or '-Infinity'"),
    **dict.fromkeys(("Number", "parseFloat", "parseInt"), "write `double(msg.text)` or `int(msg.text)`"),
    **dict.fromkeys(("toString", "to_string", "toFixed", "format"), "write `string(msg.id)`"),
    **dict.fromkeys(("empty", "isEmpty", "is_empty"), "write `size(msg.list) == 0`"),
    **dict.fromkeys(("defined", "exists", "exist", "isset"), "write `has(msg.field)`, or `msg.list.exists(x, x > 0)`"),
    **dict.fromkeys(("substring", "substr", "slice", "charAt", "split", "replace"), _TEXTS),
    **dict.fromkeys(("yaw", "pitch", "roll", "rpy", "euler", "quat2euler", "degrees", "radians"), _NO_ANGLES),
    **dict.fromkeys(("toSec", "to_sec", "toNSec", "nanoseconds"), _NO_TIMES),
    "clamp": "write `min(max(msg.x, 0), 1)`",
    "sign": "write `msg.x > 0 ? 1 : msg.x < 0 ? -1 : 0`",
    "concat": "write `msg.a + msg.b`",
    "greatest": "write `max(msg.a, msg.b)`",
    "least": "write `min(msg.a, msg.b)`",
    "all": _LIST.format("all"),
    "any": _LIST.format("exists"),
    "bool": "write a comparison, as in msg.count != 0",
    "bytes": _NO_BYTES,
    "count": "write `size(msg.list.filter(x, x > 0))`",
    "dist": "write `sqrt(msg.x * msg.x + msg.y * msg.y)`",
    "duration": _NO_TIMES,
    "dyn": "write the value alone",
    "every": _LIST.format("all"),
    "get": "a field stands behind a dot, as in msg.field",
    "fabs": "write `abs(msg.x)`",
    "float": "write `double(msg.count)`",
    **dict.fromkeys(("floor", "ceil", "round"), "write `int(msg.x)`, which leaves out what is behind the point"),
    **dict.fromkeys(("hypot", "norm", "magnitude"), "write `sqrt(msg.x * msg.x + msg.y * msg.y)`"),
    **dict.fromkeys(("prev", "previous", "old", "delta", "diff"), _ONE_MESSAGE),
    "last": f"write `msg.list[size(msg.list) - 1]` for the last element; {_ONE_MESSAGE}",
    "includes": "write `'a' in msg.list`, or `msg.text.contains('part')`",
    "isinf": "infinities arrive as texts: write `msg.x == 'Infinity' || msg.x == '-Infinity'`",
    "mod": "write `msg.count % 2`",
    "isnan": _NOT_A_NUMBER,
    "len": "write `size(msg.list)`",
    "length": "write `size(msg.list)`",
    **dict.fromkeys(("lowerAscii", "lowercase"), "write `msg.text.lower()`"),
    **dict.fromkeys(("pow", "square"), "write `msg.x * msg.x`"),
    "some": _LIST.format("exists"),
    "startswith": "write `msg.text.startsWith('start')`",
    "strip": "write `msg.text.trim()`",
    "endswith": "write `msg.text.endsWith('end')`",
    "str": "write `string(msg.id)`",
    "timestamp": _NO_TIMES,
    "toLowerCase": "write `msg.text.lower()`",
    "toUpperCase": "write `msg.text.upper()`",
    "trunc": "write `int(msg.x)`",
    "upperAscii": "write `msg.text.upper()`",
}


def unknown_function(name: str) -> str:
    """What is said of a function that there is not."""
    told = f"unknown function '{name}'"
    if name in _ELSEWHERE:
        return f"{told}; {_ELSEWHERE[name]}"
    if name.startswith("get") and name[3:4].isupper():
        return f"{told}; {_NO_TIMES}"
    hint = nearest(name, KNOWN)
    return f"{told}; {f'{hint} ' if hint else ''}known are {', '.join(sorted(KNOWN))}"


def of_module(module: str, member: str) -> str:
    """What is said of a name in a library of another language, as `math.sqrt`."""
    if member in ("pi", "tau", "e"):
        number = {"pi": math.pi, "tau": math.tau, "e": math.e}[member]
        return f"there is no `{module}`: write the number, {number}"
    if member in FUNCTIONS:
        return f"there is no `{module}`: write `{FUNCTIONS[member].usage}`"
    if member in ("inf", "nan"):
        return f"there is no `{module}`: what is not finite arrives as a text, 'NaN', 'Infinity' or '-Infinity'"
    return f"there is no `{module}`: {unknown_function(member)}"
