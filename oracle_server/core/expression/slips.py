"""What is said of an expression that can't be read: what is wrong there, and what to write instead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from oracle_server.core.expression.functions import FUNCTIONS, unknown_function
from oracle_server.core.expression.tokens import Token
from oracle_server.core.nearest import near, nearest

NO_MESSAGE = "a derived signal has no `msg`: write the names of signals, as in `limit - speed`"
NO_FIELDS = "signals have no fields: write the name of a signal alone, and declare one for the field under `signals`"
_NO_BITS = "there are no bit operators; whether a bit is set, here that of 4, is asked by `(msg.data / 4) % 2 == 1`"
_CLOSES = {"(": ")", "[": "]", "{": "}"}
_INSTEAD = {
    "=": "`=` compares nothing; write `==`",
    "===": "write `==` for `===`",
    "!==": "write `!=` for `!==`",
    "=>": "write `>=` for 'at least'; for 'implies' write `!a || b`",
    "=<": "write `<=` for `=<`",
    "<>": "write `!=` for `<>`",
    "&": "write `&&` for 'and'",
    "|": "write `||` for 'or'",
    "<<": _NO_BITS,
    ">>": _NO_BITS,
    "~": "write `!` for 'not'",
    "->": "a field stands behind a dot, as in msg.field; for 'implies' write `!a || b`",
    ";": "an expression is one value; leave `;` out",
    "and": "write `&&` for `and`",
    "or": "write `||` for `or`",
    "not": "write `!` for `not`, as in !(msg.a > 3)",
    "is": "write `==` for `is`",
    "if": "a choice is written `test ? value : otherwise`",
    "else": "a choice is written `test ? value : otherwise`",
    "lambda": "write what it computes alone, of `msg`",
    "implies": "for 'implies' write `!a || b`",
    "True": "write `true` for `True`",
    "TRUE": "write `true` for `TRUE`",
    "False": "write `false` for `False`",
    "FALSE": "write `false` for `FALSE`",
    "None": "write `has(msg.field)` to ask whether a field is there",
    "nil": "write `has(msg.field)` to ask whether a field is there",
    "NaN": "NaN arrives as a text: write `msg.x == 'NaN'`",
    "nan": "NaN arrives as a text: write `msg.x == 'NaN'`",
    "inf": "infinities arrive as the texts 'Infinity' and '-Infinity'",
    "Infinity": "infinities arrive as the texts 'Infinity' and '-Infinity'",
}


def missing(token: Token, before: Token | None) -> str:
    """What is said where a value has to stand, and another token does."""
    if before is None and token.kind == "end":
        return "the expression is empty; write a field, as in msg.data"
    if token.text in _INSTEAD and token.kind != "end":
        return _INSTEAD[token.text]
    if token.text == "/" and before is None:
        return "an expression reads the message of its own stream: write `msg.field`, without the stream's name"
    after = f"after `{before.text}`" if before is not None else "at the beginning"
    if token.kind == "end":
        return f"the expression ends too early: a value is missing {after}"
    return f"`{token.text}` is not expected {after}: a value is missing there"


def unexpected(  # noqa: PLR0911 -- a case a cause
    token: Token, before: Token | None, opened: Token | None, after: Token | None
) -> str:
    """What is said where a value has ended, and no operator follows; `opened` is the bracket that is not closed yet."""
    if token.text in ("&", "|") and after is not None and after.kind == "number":
        return _NO_BITS
    if token.kind != "end" and token.text.lower() in _INSTEAD:
        return _INSTEAD[token.text.lower()]
    if token.kind == "end" or token.text in (")", "]", "}"):
        return _bracket(token, opened)
    if token.text == ":" and opened is not None and opened.text == "[":
        return "there are no parts of lists; write msg.list[0] for one element"
    if token.text == "," and before is not None:
        return "`,` is not expected here; a list is written in square brackets, as in [1, 2]"
    if token.kind == "mark":
        return f"`{token.text}` is not expected here"
    shown = f"`{before.text}` and " if before is not None else ""
    return f"an operator is missing between {shown}`{token.text}`, such as `==` or `&&`"


def _bracket(token: Token, opened: Token | None) -> str:
    if opened is None:
        return f"this `{token.text}` closes nothing; leave it out, or open it before"
    wanted = _CLOSES[opened.text]
    if token.kind == "end":
        return f"the `{opened.text}` that opens here is not closed: a `{wanted}` is missing"
    return f"`{token.text}` does not close the `{opened.text}` before it: a `{wanted}` is missing"


def unknown_name(path: Sequence[str], variables: Iterable[str], *, compared: bool) -> str:
    """What is said of a name that is neither `msg` nor a variable, the first of a path of names.

    `compared`: it stands behind `==` or `!=`.
    """
    name = path[0]
    elsewhere = _of_type(path) or _elsewhere(name)
    if elsewhere is not None:
        return elsewhere
    told = f"unknown name '{name}'"
    if name in ("message", "m", "event", "self", "this"):
        return f"{told}; did you mean `msg`?"
    if any(abs(len(other) - len(name)) <= 1 for other in near(name, ["msg", *variables])):
        return f"{told}; {nearest(name, ['msg', *variables])}"
    if name in ("time", "now"):
        return f"{told}; an expression reads the message alone, as in msg.field"
    text = f", or '{name}' for the text" if compared else ""
    constant = no_constant(name)
    if constant is not None:
        return f"{told}; {constant}{text}"
    return f"{told}; an expression reads `msg`: write `msg.{name}` for the field{text}"


def no_constant(name: str) -> str | None:
    """What to write for a constant of a message's type, whose name is in capital letters; None for any other name."""
    if len(name) < 2 or not name.isupper():
        return None
    return f"constants of a message's type are not read: write the number that its .msg file gives for `{name}`"


def _of_type(path: Sequence[str]) -> str | None:
    """What to write for a constant behind its type's name, as `GoalStatus.STATUS_ABORTED`; None for any other path."""
    constant = no_constant(path[-1]) if len(path) > 1 and path[-2][:1].isupper() else None
    return None if constant is None else f"unknown name '{path[0]}'; {constant}"


def is_foreign(name: str) -> bool:
    """Whether a name is a word of another language."""
    return name in _INSTEAD or name.lower() in ("and", "or", "not")


def _elsewhere(name: str) -> str | None:
    """What to write for a word of another language, None for any other name."""
    if name in _INSTEAD or name.lower() in ("and", "or", "not"):
        return _INSTEAD.get(name) or _INSTEAD[name.lower()]
    if name in ("pi", "PI", "M_PI"):
        return f"there is no `{name}`: write the number, {math.pi}"
    if name in FUNCTIONS:
        return f"write `{FUNCTIONS[name].usage}`"
    return unknown_function(name) if name in ("float", "str", "bool") else None


def no_power(mark: str, base: str, exponent: str) -> str:
    """What to write for a power, or an exclusive or, by this mark; `exponent` is the token behind its sign."""
    if exponent == "0.5":
        return f"there is no power; write `sqrt({base})`"
    product = " * ".join([base] * (3 if exponent == "3" else 2))
    if mark == "^" and exponent not in ("2", "3"):
        return f"there is no power: write `{product}` and so on; {_NO_BITS}"
    return f"there is no power; write `{product}`" + ("" if exponent in ("2", "3") else " and so on")


def compared(mark: str, left: str, right: str) -> str | None:
    """What to write for a comparison that there is not, of an operand with the token `right`; None for any other."""
    if mark not in ("is", "is not", "not in", "==", "!=", "===", "!=="):
        return None
    if right in ("None", "nil", "undefined"):
        if mark in ("is not", "!=", "!=="):
            return f"write `has({left})` to ask whether a field is there"
        return f"write `!has({left})` to ask whether a field is missing"
    if mark == "not in":
        return f"write `!({left} in [1, 2])` for `not in`"
    return "write `!=` for `is not`" if mark == "is not" else None
