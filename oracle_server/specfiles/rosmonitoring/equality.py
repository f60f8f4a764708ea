"""Which values are equal, and which are inside of others: Python's 1 and True are equal, and CEL's are not."""

from __future__ import annotations

from typing import Any

from oracle_server.core.shapes import Many, Record
from oracle_server.core.shapes import Value as Single
from oracle_server.specfiles.rosmonitoring.cel import FAILS, field, has, inner, literal, negated, text_of
from oracle_server.specfiles.rosmonitoring.fields import there
from oracle_server.specfiles.rosmonitoring.values import (
    Const,
    Field,
    Items,
    Leaf,
    Message,
    Name,
    Raises,
    Term,
    UntranslatableError,
    Value,
    choice,
    each,
    leaves,
)

_KINDS: dict[type, str] = {int: "number", float: "number", str: "text"}
_NOT_FINITE = ("NaN", "Infinity", "-Infinity")
"""Texts as which numbers arrive that are not finite."""
TRUE, FALSE = Const(True), Const(False)


def equal(left: Leaf, right: Leaf) -> Value:  # noqa: C901, PLR0911, PLR0912 -- a case a pair
    """`==`, in which Python's 1 and True are equal and CEL's are not, and Python's NaN differs from itself."""
    if (isinstance(left, Const) and not isinstance(right, Const)) or (
        isinstance(left, Term) and isinstance(right, Field)
    ):
        left, right = right, left
    match left, right:
        case Const(a), Const(b):
            if isinstance(a, Name) or isinstance(b, Name):
                return Const(isinstance(a, str) and isinstance(b, str) and a.strip("/") == b.strip("/"))
            return Const(a == b)
        case Field(_, Many() | Record()), Const(value) if not isinstance(value, list | tuple | dict):
            return FALSE
        case Field(path), Const(value):
            return _field_is(field(path), value)
        case Term(_, "bool"), Const(bool() | int() | float() as value):
            return (left if value else negated(left)) if value in (0, 1) else FALSE
        case Term(_, "number"), Const(bool() | int() | float() as value):
            return Term(f"{inner(left)} == {literal(_plain(value))}", "bool")
        case Term(_, "text"), Const(str() as value):
            return Term(f"{inner(left)} == {literal(value)}", "bool")
        case Term(kind="bool" | "number" | "text"), Const(None | str() | bool() | int() | float() | list() | tuple()):
            return FALSE
        case Field(_, Many() | Record()), Term():
            return FALSE
        case Field(a, None), Field(b, None):
            one, other = field(a), field(b)
            alike = f"({one} in [true, false]) == ({other} in [true, false])"
            return _where(f"{one} != 'NaN' && {alike}", f"{one} == {other}")
        case (Field(path, None), Term(kind="number" | "text") as term):
            return _where(f"!({field(path)} in [true, false])", f"{field(path)} == {inner(term)}")
        case Term(_, "number", whole=None), Term(_, "number", whole=None):
            return Term(f"{inner(left)} == {inner(right)} && {inner(left)} != 'NaN'", "bool")
        case Term(_, one), Term(_, other) if one == other:
            return Term(f"{inner(left)} == {inner(right)}", "bool")
        case (Term(kind="text"), Term(kind="number")) | (Term(kind="number"), Term(kind="text")):
            return FALSE
    raise UntranslatableError


def _field_is(text: str, value: object) -> Value:
    if value in _NOT_FINITE:
        raise UntranslatableError
    if isinstance(value, bool) or (isinstance(value, int | float) and value in (0, 1)):
        return Term(f"{text} in [{'true, 1' if value else 'false, 0'}]", "bool")
    if isinstance(value, list | tuple) and any(isinstance(v, bool | list | tuple) or v in (0, 1) for v in value):
        raise UntranslatableError
    return Term(f"{text} == {literal(value)}", "bool")


def _where(test: str, then: str) -> Term:
    return Term(f"({test}) ? ({then}) : {FAILS}", "bool")


def _plain(value: Any) -> Any:
    return int(value) if isinstance(value, bool) else value


def identical(left: Leaf, right: Leaf) -> Value:
    """`is`, of None, True and False. Raises `UntranslatableError`."""
    match left, right:
        case Const(a), Const(None | bool() as b):
            return Const(a is b)
        case Field(path, None), Const(None | bool() as b):
            return Term(f"{field(path)} == {literal(b)}", "bool")
        case Term(_, "bool"), Const(bool() as b):
            return left if b else negated(left)
        case ((Term() | Field()), Const(None | bool())):
            return FALSE
    raise UntranslatableError


def inside(left: Leaf, right: Leaf) -> Value:  # noqa: C901, PLR0911 -- a case a pair
    """`in`: of a constant's items, of a text, of the message's fields."""
    match left, right:
        case Const(a), Const(list() | tuple() | set() | frozenset() | dict() as b):
            found: Value = FALSE
            for item in b:
                found = choice(equal(Const(a), Const(item)), TRUE, found)
            return found
        case Const(str() as a), Const(str() as b):
            return Const(a in b)
        case _, Const(list() | tuple() | set() | frozenset() | dict() as b):
            return _any_of(left, [Const(item) for item in b])
        case _, Items(values) if not (
            _may_be_nan(left) and any(_may_be_nan(leaf) for v in values for leaf in leaves(v))
        ):
            return _any_of(left, list(values))
        case Const(str() as key), Field(_, Record()):
            return there(right, key)
        case ((Const() | Term()), Field(path, Many(of=Single(kind=kind)))):
            return _in_list(left, kind, field(path))
        case Const(str() as key), Field(path, None):
            return Term(f"{field(path)}.contains({literal(key)})", "bool", tight=True)
        case ((Const(str()) | Term(kind="text")), Term(_, "text")):
            return Term(f"{inner(right)}.contains({text_of(left)})", "bool", tight=True)
        case ((Const() | Term()), Term()):
            return Raises("TypeError")
        case Const(str() as key), Message():
            return has((key,))
    raise UntranslatableError


def _may_be_nan(value: Leaf) -> bool:
    """Whether a value may be NaN, which Python finds in a list though it equals nothing."""
    return isinstance(value, Field) or (isinstance(value, Term) and value.kind == "number" and value.whole is not True)


def _any_of(left: Leaf, values: list[Value]) -> Value:
    known = [v.value for v in values if isinstance(v, Const)]
    if isinstance(left, Term) and left.kind != "bool" and len(known) == len(values):
        alike = [_plain(v) for v in known if isinstance(v, str if left.kind == "text" else int | float)]
        return Term(f"{inner(left)} in {literal(alike)}", "bool") if alike else FALSE
    if isinstance(left, Field) and len(known) == len(values) > 0 and all(_plainly_equal(v) for v in known):
        return Term(f"{field(left.path)} in {literal(known)}", "bool")
    found: Value = FALSE
    for value in reversed(values):
        found = choice(each(value, lambda item: equal(left, item)), TRUE, found)
    return found


def _plainly_equal(value: object) -> bool:
    """Whether CEL finds the same values equal to this one as Python: not to 0 and 1, which are False and True there."""
    return (isinstance(value, str) and value not in _NOT_FINITE) or (
        isinstance(value, int | float) and value not in (0, 1)
    )


def _in_list(leaf: Const | Term, kind: str, text: str) -> Value:
    """Whether a list of numbers or texts has a value; not of Booleans, which are numbers in Python."""
    wanted = leaf.kind if isinstance(leaf, Term) else _KINDS.get(type(leaf.value))
    if wanted not in ("number", "text") or kind not in ("whole", "real", "text"):
        raise UntranslatableError
    if (kind == "text") is not (wanted == "text"):
        return FALSE
    return Term(f"{literal(leaf.value) if isinstance(leaf, Const) else inner(leaf)} in {text}", "bool")
