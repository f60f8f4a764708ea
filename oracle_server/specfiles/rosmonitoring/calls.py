"""Python's functions and methods over values: `abs`, `len`, `float`, `.get`, `.startswith` and their like."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable, Sequence
from typing import Any

from oracle_server.core.shapes import Many, Record
from oracle_server.core.shapes import Value as Single
from oracle_server.specfiles.rosmonitoring.cel import bare, field, inner, literal, number, truth
from oracle_server.specfiles.rosmonitoring.equality import FALSE, TRUE
from oracle_server.specfiles.rosmonitoring.fields import member, there
from oracle_server.specfiles.rosmonitoring.operators import compare
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Items,
    Leaf,
    Message,
    Raises,
    Table,
    Term,
    UntranslatableError,
    Value,
    choice,
    each,
)

_ON_CONSTANTS: dict[str, Callable[..., Any]] = {
    "abs": abs, "bool": bool, "dict": dict, "float": float, "int": int, "len": len, "list": list, "max": max,
    "min": min,
    "round": round, "set": set, "sorted": sorted, "str": str, "sum": sum, "tuple": tuple,
    "zip": lambda *a: list(zip(*a, strict=False)),
    "enumerate": lambda a: list(enumerate(a)), "frozenset": frozenset, "range": lambda *a: _range(*a),  # noqa: PLW0108 -- defined below
}  # fmt: skip
_METHODS = frozenset({
    "capitalize", "count", "endswith", "find", "format", "get", "index", "items", "join", "keys", "lower", "lstrip",
    "removeprefix", "removesuffix", "replace", "rstrip", "split", "startswith", "strip", "title", "upper", "values",
})  # fmt: skip
_FAILURES = (TypeError, ValueError, KeyError, IndexError, OverflowError, ArithmeticError, AttributeError)


def _range(*bounds: int) -> list[int]:
    found = range(*bounds)
    if len(found) > 1024:
        raise UntranslatableError
    return list(found)


def function(name: str, arguments: Sequence[Value]) -> Value:  # noqa: C901, PLR0911, PLR0912 -- a case a function
    """A built-in function. Raises `UntranslatableError`."""
    if all(isinstance(a, Const) for a in arguments) and name in _ON_CONSTANTS:
        return known(_ON_CONSTANTS[name], [a.value for a in arguments if isinstance(a, Const)])
    match name, list(arguments):
        case "abs", [value]:
            return each(value, _absolute)
        case "bool", [value]:
            return each(value, truth)
        case "float", [value]:
            return each(value, lambda leaf: _number_of(leaf, "double"))
        case "int", [value]:
            return each(value, lambda leaf: _number_of(leaf, "int"))
        case "len", [value]:
            return each(value, _length)
        case "str", [value]:
            return each(value, _shown)
        case (("max" | "min"), [Field(_, None | Many()) as whole]):
            return _extreme(name, whole)
        case (("max" | "min"), [first, *rest]) if rest:
            op = ast.Gt() if name == "max" else ast.Lt()
            for other in rest:
                first = choice(compare(other, op, first), other, first)
            return first
        case (("max" | "min"), [Items(values)]) if values:
            return function(name, values) if len(values) > 1 else values[0]
        case (("any" | "all"), [Items(values)]):
            return _quantified(name, values)
        case (("any" | "all"), [Const(list() | tuple() | set() as found)]):
            return Const(any(found) if name == "any" else all(found))
        case (("list" | "tuple" | "set"), [Items() as items]):
            return items
    raise UntranslatableError


def _quantified(name: str, values: Sequence[Value]) -> Value:
    found: Value = FALSE if name == "any" else TRUE
    for value in reversed(values):
        test = each(value, truth)
        found = choice(test, TRUE, found) if name == "any" else choice(test, found, FALSE)
    return found


def known(work: Callable[..., Any], arguments: Sequence[object]) -> Value:
    """What a function says of constants. Raises `UntranslatableError` where that is large."""
    wide = re.compile(r"\d{4,}")  # a width, as in '{:>100000000}'
    if any(isinstance(a, str | list | tuple | dict) and len(a) > 1024 for a in arguments):
        raise UntranslatableError
    if getattr(work, "__name__", "") == "format" and wide.search(str(getattr(work, "__self__", ""))):
        raise UntranslatableError
    try:
        found = work(*arguments)
    except _FAILURES as error:
        return Raises(type(error).__name__)
    if isinstance(found, str | list | tuple) and len(found) > 4096:
        raise UntranslatableError
    return Const(list(found) if type(found).__name__ in ("dict_items", "dict_keys", "dict_values") else found)


def _absolute(leaf: Leaf) -> Value:
    if isinstance(leaf, Const):
        return known(abs, [leaf.value])
    if isinstance(leaf, Term) and leaf.kind == "number":
        return Term(f"abs({bare(leaf.text)})", "number", tight=True, whole=leaf.whole)
    return Term(f"abs({bare(number(leaf))})", "number", tight=True)


def _shown(leaf: Leaf) -> Value:
    match leaf:
        case Const(value):
            return known(str, [value])
        case Term(_, "text"):
            return leaf
        case Term(text, "number", whole=True):
            return Term(f"string({text})", "text", tight=True)
        case Term(_, "bool"):
            return Term(f"({inner(leaf)} ? 'True' : 'False')", "text", tight=True)
    raise UntranslatableError


def _extreme(name: str, leaf: Field) -> Value:
    """The largest or smallest of a list of numbers; those that are not finite arrive as texts, which `double` reads."""
    text = field(leaf.path)
    match leaf.shape:
        case Many(of=Single(kind="real")):
            return Term(f"{name}({text}.map(v, double(v)))", "number", tight=True)
        case Many(of=Single(kind="whole")):
            return Term(f"{name}({text})", "number", tight=True, whole=True)
        case None:
            return Term(f"{name}({text})", "number", tight=True, whole=None)
    raise UntranslatableError


def _number_of(leaf: Leaf, kind: str) -> Value:
    match leaf:
        case Const(value):
            return known(float if kind == "double" else int, [value])
        case Term(_, "bool"):
            return Term(f"({inner(leaf)} ? 1 : 0)", "number", tight=True, whole=True)
        case Term(text) if kind == "double":
            return Term(number(leaf) if leaf.kind == "number" else f"double({text})", "number", tight=True)
        case Term(text):
            return leaf if leaf.whole else Term(f"int({text})", "number", tight=True, whole=True)
        case Field(path, None):
            return Term(f"{kind}({field(path)})", "number", tight=True, whole=kind == "int")
    raise UntranslatableError


def _length(leaf: Leaf) -> Value:  # noqa: PLR0911 -- a case a kind of leaf
    match leaf:
        case Const(str() | list() | tuple() | set() | dict() as value):
            return Const(len(value))
        case Items(values):
            return Const(len(values))
        case Const():
            return Raises("TypeError")
        case Field(_, Many(length=int() as length)):
            return Const(length)
        case Field(_, Record(fields=fields)):
            return Const(len(fields))
        case Field(path, None | Many()):
            return Term(f"size({field(path)})", "number", tight=True, whole=True)
        case Term(text, "text"):
            return Term(f"size({text})", "number", tight=True, whole=True)
        case Term():
            return Raises("TypeError")
    raise UntranslatableError


def method(base: Leaf, name: str, arguments: Sequence[Value]) -> Value:  # noqa: PLR0911 -- a case a kind of leaf
    """A method of a constant, of a field, or of a dict that the function made. Raises `UntranslatableError`."""
    constants = [a.value for a in arguments if isinstance(a, Const)]
    open_ones = len(constants) < len(arguments)
    match base, name:
        case Const(None | bool() | int() | float()), _:
            return Raises("AttributeError")
        case Const(str() | list() | tuple() | dict() as value), _ if name in _METHODS and not open_ones:
            if not hasattr(value, name):
                return Raises("AttributeError")
            return known(getattr(value, name), constants)
        case Term(kind="bool" | "number"), _ if not hasattr(float, name) and not hasattr(int, name):
            return Raises("AttributeError")
        case Field(), "get" if constants and isinstance(constants[0], str):
            default = arguments[1] if len(arguments) > 1 else Const(None)
            test = there(base, constants[0])
            return choice(test, default if test == FALSE else member(base, constants[0]), default)
        case Table(values), "get" if constants:
            return dict(values).get(str(constants[0]), arguments[1] if len(arguments) > 1 else Const(None))
        case ((Field(_, None) | Term(kind="text")), _):
            return _of_text(field(base.path) if isinstance(base, Field) else inner(base), name, arguments)
    raise UntranslatableError


def _of_text(text: str, name: str, arguments: Sequence[Value]) -> Value:
    match name, list(arguments):
        case (("lower" | "upper"), []):
            return Term(f"{text}.{name}()", "text", tight=True)
        case "strip", []:
            return Term(f"{text}.trim()", "text", tight=True)
        case (("startswith" | "endswith"), [Const(str() as wanted)]):
            return Term(f"{text}.{name[:-4]}With({literal(wanted)})", "bool", tight=True)
        case (("startswith" | "endswith"), [Const(tuple() as several)]) if all(isinstance(s, str) for s in several):
            parts = [_of_text(text, name, [Const(one)]) for one in several]
            return _quantified("any", parts)
    raise UntranslatableError


def mathematics(name: str, arguments: Sequence[Value]) -> Value:
    """A function of the module `math`. Raises `UntranslatableError`."""
    if name == "fabs":
        return function("abs", [function("float", arguments)])
    if name == "sqrt" and len(arguments) == 1 and not isinstance(arguments[0], Const):
        return each(arguments[0], lambda leaf: Term(f"sqrt({bare(number(leaf))})", "number", tight=True))
    work = getattr(math, name, None)
    if not callable(work) or not all(isinstance(a, Const) for a in arguments) or name in ("factorial", "comb", "perm"):
        raise UntranslatableError
    return known(work, [a.value for a in arguments if isinstance(a, Const)])


def kind_of(leaf: Leaf, wanted: str) -> Value:  # noqa: PLR0911 -- a case a kind of leaf
    """`isinstance(leaf, wanted)`."""
    match leaf, wanted:
        case Const(value), _ if wanted in ("bool", "int", "float", "str", "list", "dict", "tuple"):
            return Const(isinstance(value, {"bool": bool, "int": int, "float": float, "str": str, "list": list,
                                            "dict": dict, "tuple": tuple}[wanted]))  # fmt: skip
        case Message(), _:
            return Const(wanted == "dict")
        case Field(path, None), "bool":
            return Term(f"{field(path)} in [true, false]", "bool")
        case Field(_, Many()), _:
            return Const(wanted == "list")
        case Field(_, Record()), _:
            return Const(wanted == "dict")
        case Term(_, "bool"), _:
            return Const(wanted in ("bool", "int"))
        case Term(_, "text"), _:
            return Const(wanted == "str")
        case Term(_, "number", whole=True), _:
            return Const(wanted == "int")
        case Term(_, "number", whole=None), _:
            return Const(wanted == "float")
    raise UntranslatableError
