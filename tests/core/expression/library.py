"""Random typed expressions and messages, and what the CEL library makes of them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from random import Random
from typing import Any

import cel
from hypothesis import strategies as st

NOTHING = "no value"
MESSAGE = {
    "n": st.integers(-3, 7) | st.sampled_from([2**40, -(2**40)]),
    "m": st.integers(-3, 7),
    "x": st.sampled_from([0.0, 2.5, -1.5, 7.0, 1e300, -0.0]) | st.floats(-100, 100),
    "y": st.sampled_from([0.5, 7.0, 1e-7]),
    "b": st.booleans(),
    "c": st.booleans(),
    "s": st.sampled_from(["", "on", "off", "map_12", "7", "NaN", "Infinity", "a'b"]) | st.text("abz_19 ", max_size=6),
    "t": st.sampled_from(["o", "on", "-7", "2.5"]),
    "l": st.lists(st.integers(-3, 7), max_size=4),
    "w": st.lists(st.sampled_from(["on", "off", "", "7"]), max_size=3),
}


def messages() -> st.SearchStrategy[dict[str, Any]]:
    """Messages whose fields are of these types, some of which are missing or null."""
    there = st.fixed_dictionaries({"n": MESSAGE["n"], "b": MESSAGE["b"], "l": MESSAGE["l"]})
    fields = {name: values | st.none() if name in "mxst" else values for name, values in MESSAGE.items()}
    return st.builds(lambda a, b: {**b, **a}, there, st.fixed_dictionaries({}, optional=fields))


def expression(random: Random, kind: str | None = None, depth: int = 3, variables: tuple[str, ...] = ()) -> str:
    """A random expression of a kind: `whole`, `real`, `bool`, `text` or `list`."""
    kind = kind or random.choice(["whole", "real", "bool", "text", "bool"])
    if depth == 0 or random.random() < 0.2:
        return random.choice([*_LEAVES[kind], *(variables if kind == "whole" else ())])
    written = random.choice([*_FORMS[kind], "({bool} ? {" + kind + "} : {" + kind + "})"])
    inner = (*variables, "uvw"[depth - 1]) if "VAR" in written else variables
    parts = re.split(r"\{(\w+)\}", written.replace("VAR", "uvw"[depth - 1]))
    for i in range(1, len(parts), 2):
        known = inner if i > 1 else variables
        parts[i] = random.choice(_MARKS) if parts[i] == "mark" else expression(random, parts[i], depth - 1, known)
    return "".join(parts)


_FORMS = {
    "whole": ["({whole} + {whole})", "({whole} - {whole})", "({whole} * {whole})", "({whole} / {whole})",
              "({whole} % {whole})", "-({whole})", "int({real})", "int({text})", "size({list})", "{text}.size()",
              "msg.l[{whole}]"],
    "real": ["({real} + {real})", "({real} - {real})", "({real} * {real})", "({real} / {real})", "-({real})",
             "double({whole})", "double({text})"],
    "bool": ["({bool} && {bool})", "({bool} || {bool})", "({bool} && {bool} && {bool})", "!({bool})",
             "({whole}{mark}{whole})", "({real}{mark}{real})", "({text}{mark}{text})", "({bool}{mark}{bool})",
             "({whole}{mark}{real})", "({text} == {whole})", "({list} == {list})", "({whole} in {list})",
             "({text} in ['on', 'off', {text}])", "{text}.contains({text})", "{text}.startsWith({text})",
             "{text}.endsWith({text})", "{text}.matches('^o[nf]+$')", "{text}.matches('[a-z]_[0-9][0-9]?|b')",
             "{list}.exists(VAR, {bool})", "{list}.all(VAR, {bool})", "{list}.exists_one(VAR, {bool})"],
    "text": ["string({whole})", "string({real})", "({text} + {text})"],
    "list": ["{list}.filter(VAR, {bool})", "{list}.map(VAR, {whole})", "[{whole}, {whole}]", "({list} + {list})"],
}  # fmt: skip
_MARKS = [" < ", " <= ", " > ", " >= ", " == ", " != "]
_LEAVES = {
    "whole": ["msg.n", "msg.m", "0", "7", "-3", "2"],
    "real": ["msg.x", "msg.y", "2.5", "-1.5e1", "0.0", "1e300"],
    "bool": ["msg.b", "msg.c", "true", "false", "has(msg.x)", "has(msg.gone)", "(msg.s == null)"],
    "text": ["msg.s", "msg.t", "'on'", '"7"', "''", r"'\x41\n'", r"r'\a'"],
    "list": ["msg.l", "[1, 2, 7]", "[]"],
}


def by_library(text: str, message: Mapping[str, Any]) -> Any:
    """The library's value, or `NOTHING`."""
    context = cel.Context()
    context.add_variable("msg", dict(message))
    try:
        return cel.compile(text).execute(context)
    except Exception:  # noqa: BLE001 -- the library raises a dozen types
        return NOTHING


def told_apart(value: Any) -> Any:
    """A value with its type, so that 1, 1.0 and True differ, and NaN is NaN."""
    if isinstance(value, float) and math.isnan(value):
        return ("float", "NaN")
    if isinstance(value, list):
        return [told_apart(each) for each in value]
    return (type(value).__name__, repr(value))
