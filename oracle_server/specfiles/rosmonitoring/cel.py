"""CEL for values: literals, fields, numbers, truth, and whole trees."""

from __future__ import annotations

import math
from typing import Literal

from oracle_server.core.shapes import Many, Record
from oracle_server.core.shapes import Value as Single
from oracle_server.specfiles.rosmonitoring.values import (
    Choice,
    Const,
    Field,
    Items,
    Kept,
    Key,
    Leaf,
    Message,
    Raises,
    Table,
    Term,
    UntranslatableError,
    Value,
    Variable,
    each,
    leaves,
)

_RESERVED = frozenset({
    "as", "break", "const", "continue", "else", "false", "for", "function", "if", "import", "in", "let", "loop", "null",
    "namespace", "package", "return", "true", "var", "void", "while",
})  # fmt: skip

TODO = "todo()"
"""The expression of a signal that could not be written, which `check` warns of."""
FAILS = "unknown()"
"""The expression of what made the module fail."""

_SMALL = 6
"""Most leaves of a tree that is kept: its tests need not be asked again below."""

Use = Literal["bool", "number", "text", "any"]
"""What a formula compares a predicate with."""


def literal(value: object) -> str:
    """A constant as CEL. Raises `UntranslatableError`."""
    match value:
        case None:
            return "null"
        case bool():
            return "true" if value else "false"
        case int() if abs(value) < 2**53:
            return str(value)
        case float() if math.isfinite(value):
            return repr(value)
        case str() if value.isprintable() and "'" not in value and "\\" not in value:
            return f"'{value}'"
        case list() | tuple():
            return f"[{', '.join(literal(v) for v in value)}]"
    raise UntranslatableError


def field(path: tuple[Key, ...]) -> str:
    """A field as CEL. Raises `UntranslatableError`."""
    text = "msg"
    for key in path:
        if isinstance(key, Variable):
            text = key
        elif isinstance(key, int):
            text += f"[{key}]" if key >= 0 else f"[size({text}) - {-key}]"
        elif key.isidentifier() and key.isascii() and key not in _RESERVED:
            text += f".{key}"
        else:
            text += f"[{literal(key)}]".replace("'", '"')
    return text


def has(path: tuple[Key, ...]) -> Term:
    """Whether a field is there. Raises `UntranslatableError`."""
    text = field(path)
    if text.endswith("]"):
        raise UntranslatableError
    return Term(f"has({text})", "bool", tight=True)


def inner(term: Term) -> str:
    """A term's text, as an operand."""
    return term.text if term.tight else f"({term.text})"


def bare(text: str) -> str:
    """An operand without the parentheses around all of it."""
    depth = 0
    for i, mark in enumerate(text):
        depth += (mark == "(") - (mark == ")")
        if depth == 0 and i < len(text) - 1:
            return text
    return text[1:-1] if text.startswith("(") and "'" not in text else text


def truth(leaf: Leaf) -> Value:  # noqa: C901, PLR0911 -- a case a kind of leaf
    """Whether Python takes a value for true."""
    match leaf:
        case Const(value):
            return Const(bool(value))
        case Term(_, "bool"):
            return leaf
        case Term(_, "number"):
            return Term(f"{inner(leaf)} != 0", "bool")
        case Term(_, "text"):
            return Term(f"{inner(leaf)} != ''", "bool")
        case Items(values) | Table(values):
            return Const(bool(values))
        case Message():
            return Const(True)  # it has its topic or service, at least
        case Field(path, Record(fields=fields)):
            return Const(bool(fields))
        case Field(path, Many(length=None)):
            return Term(f"size({field(path)}) > 0", "bool")
        case Field(path, Many(length=length)):
            return Const(bool(length))
        case Field(path, Single(kind="bytes")):
            return Term(f"{field(path)} != ''", "bool")
        case Field(path):
            return Term(f"!({field(path)} in [false, 0, null, '', [], {{}}])", "bool", tight=True)
    raise UntranslatableError


def number(leaf: Leaf) -> str:
    """A number as CEL has it with a point, so that whole ones and others are reckoned with each other.

    A text that is a number is none: `double` would read it, and Python fails.
    """
    match leaf:
        case Const(bool() | int() | float() as value):
            if abs(value) < 2**53:
                return literal(float(value))
        case Term(_, "number", whole=False):
            return inner(leaf)
        case Term(_, "number"):
            return f"double({leaf.text})"
        case Term(_, "bool"):
            return f"({inner(leaf)} ? 1.0 : 0.0)"
        case Field(path, None):
            return f"({field(path)} * 1.0)"
    raise UntranslatableError


def text_of(leaf: Leaf) -> str:
    """A text as an operand. Raises `UntranslatableError`."""
    match leaf:
        case Const(str() as value):
            return literal(value)
        case Field(path):
            return field(path)
        case Term(_, "text"):
            return inner(leaf)
    raise UntranslatableError


def negated(term: Term) -> Term:
    """The contrary of a Boolean term."""
    if term.text.startswith("size(") and term.text.endswith(") > 0") and term.text.count(")") == 1:
        return Term(f"{term.text.removesuffix(' > 0')} == 0", "bool")
    for op, contrary in ((" == ", " != "), (" != ", " == ")):
        one, found, other = term.text.partition(op)
        if found and not term.tight and not any(mark in one + other for mark in ("==", "!=", *"&|?<>(")):
            return Term(f"{one}{contrary}{other}", "bool")
    return Term(term.text[1:] if term.text.startswith("!(") and term.tight else f"!({term.text})", "bool", tight=True)


def fitted(value: Value, use: Use) -> Value:
    """A predicate's tree with values of the type that a formula compares, as reelay converts them."""
    return each(value, lambda leaf: _fit(leaf, use))


def _fit(leaf: Leaf, use: Use) -> Value:  # noqa: C901, PLR0911 -- a case a kind of leaf
    match leaf, use:
        case Kept(), _:
            return leaf
        case Field(_, Many() | Record()), _:
            return Raises("a list or a message, where the formula has a single value")
        case Field(_, Single()), _:
            raise UntranslatableError
        case Const(None | bool() | int() | float() as value), "bool":
            return Const(bool(value))
        case ((Term(kind="bool" | "number") | Field()), "bool"):
            return _flag(leaf)
        case Const(bool() | int() | float() as value), "number":
            return Const(int(value) if isinstance(value, bool) else value)
        case ((Term(kind="bool" | "number") | Field()), "number"):
            whole = isinstance(leaf, Term) and leaf.kind == "number"
            return leaf if whole else Term(number(leaf), "number", tight=True)
        case ((Const(str()) | Term(kind="text") | Field()), "text"):
            return leaf
        case ((Const(str() | int() | float()) | Term() | Field()), "any"):
            return leaf
        case ((Const() | Term()), _):
            return Raises("a value of another type than the formula's")
    raise UntranslatableError


def _flag(leaf: Term | Field) -> Value:
    if isinstance(leaf, Term):
        return truth(leaf)
    text = field(leaf.path)
    return Term(f"({text} in [true, false, null] ? {text} == true : abs({text}) > 0)", "bool", tight=True)


def rendered(value: Value) -> str:
    """A tree as CEL; `Kept` is null, so that the signal is absent there. Raises `UntranslatableError`."""
    return _tree(value).text


def collapsed(value: Value) -> Value:
    """A large tree of Booleans as one term, so that it does not grow with each `and`."""
    if (
        not isinstance(value, Choice)
        or len(leaves(value)) <= _SMALL
        or not all(
            (isinstance(leaf, Const) and isinstance(leaf.value, bool))
            or (isinstance(leaf, Term) and leaf.kind == "bool")
            for leaf in leaves(value)
        )
    ):
        return value
    return _tree(value)


def _tree(value: Value) -> Term:
    match value:
        case Choice(test, yes, no):
            return _chosen(test, _tree(yes), _tree(no))
        case Const(constant):
            return Term(literal(constant), "bool" if isinstance(constant, bool) else "text", tight=True)
        case Term():
            return value
        case Field(path):
            return Term(field(path), "text", tight=True)
        case Kept():
            return Term("null", "text", tight=True)
        case Raises():
            return Term(FAILS, "text", tight=True)
    raise UntranslatableError


def _chosen(test: Term, yes: Term, no: Term) -> Term:
    if (yes.text, no.text) == ("true", "false"):
        return test
    if (yes.text, no.text) == ("false", "true"):
        return negated(test)
    if no.text == "false" and yes.kind == "bool":
        return Term(f"{_joined(test, '&&')} && {_joined(yes, '&&')}", "bool")
    if yes.text == "true" and no.kind == "bool":
        return Term(f"{_joined(test, '||')} || {_joined(no, '||')}", "bool")
    if yes.text == "false" and no.kind == "bool":
        return Term(f"{inner(negated(test))} && {_joined(no, '&&')}", "bool")
    kind = yes.kind if yes.kind == no.kind else "text"
    return Term(f"{inner(test)} ? {inner(yes)} : {inner(no)}", kind)


def _joined(term: Term, op: str) -> str:
    if term.tight or not any(mark in term.text for mark in ("||", "&&", "?")):
        return term.text
    alone = op in term.text and not any(mark in term.text for mark in {"||", "&&", "?"} - {op})
    return term.text if alone else f"({term.text})"
