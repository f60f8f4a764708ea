"""What is known of a value before any message: its shape, in words, and what two known values have in common."""

from __future__ import annotations

from dataclasses import dataclass

from oracle_server.core.expression.slips import no_constant
from oracle_server.core.nearest import nearest
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value, ValueKind


@dataclass(frozen=True, slots=True)
class Elements:
    """A list that the expression makes, of what is known of its elements."""

    of: Static


Static = Value | Many | Record | Elements | None
"""None where nothing is known."""

WHOLE, REAL, BOOL, TEXT = (Value(kind, "") for kind in ("whole", "real", "bool", "text"))
"""What expressions make; a value without a type stands in no field."""
INFINITE = frozenset({"Infinity", "-Infinity"})
NOT_FINITE = INFINITE | {"NaN"}
"""The texts as which real fields arrive that are not finite."""
_WORDS: dict[ValueKind, str] = {
    "whole": "a whole number",
    "real": "a real number",
    "bool": "true or false",
    "text": "a text",
    "bytes": "bytes, which arrive as a text in base64",
}
_FIELDS = 12
"""Most fields that a message names."""


def static_of(shape: Shape | None) -> Static:
    """What is known of a value in a message, or of a message, by its shape."""
    return None if isinstance(shape, Unknown) else shape


def kind(static: Static) -> ValueKind | None:
    """The kind of a single value, None where it is not known or no single value."""
    return static.kind if isinstance(static, Value) else None


def written(value: object) -> Static:
    """What is known of a value that is written out."""
    return {int: WHOLE, float: REAL, bool: BOOL, str: TEXT}.get(type(value))


def is_number(static: Static) -> bool:
    """Whether a value is known to be a number."""
    return kind(static) in ("whole", "real")


def is_text(static: Static) -> bool:
    """Whether a value is known to arrive as a text."""
    return kind(static) in ("text", "bytes")


def element(static: Static) -> Static:
    """What is known of the elements of a list."""
    if isinstance(static, Many):
        return static_of(static.of)
    return static.of if isinstance(static, Elements) else None


def common(one: Static, other: Static) -> Static:
    """What is known of a value that is the one or the other."""
    if one == other:
        return one
    if isinstance(one, Value) and isinstance(other, Value) and one.kind == other.kind:
        return Value(one.kind, "")
    return None


def result_of(mark: str, one: Static, other: Static) -> Static:
    """What is known of the result of an operation that succeeds."""
    kinds = {kind(one), kind(other)}
    if mark == "%" or kinds == {"whole"}:
        return WHOLE
    if "real" in kinds:
        return REAL
    if mark == "+" and kinds and kinds <= {"text", "bytes"}:
        return TEXT
    if mark == "+" and all(isinstance(s, Many | Elements) for s in (one, other)):
        return Elements(common(element(one), element(other)))
    return None


def described(static: Static | Unknown) -> str:
    """A known value in words, as `float64` or `a list of geometry_msgs/msg/Point`."""
    match static:
        case Value(kind=what, type=type_):
            return type_ if type_ and what != "bytes" else _WORDS[what]
        case Many(of=of) | Elements(of=of):
            return f"a list of {described(of)}" if of is not None else "a list"
        case Record(name=name) | Unknown(name=name):
            return name or "a message"
        case _:
            return "not known"


def not_single(static: Static, text: str) -> str:
    """What to say behind a value that is used as a list; empty where it has nothing that looks like elements."""
    if kind(static) == "bytes":
        return (
            f"; single bytes are not read: compare all of them, as in `{text} == 'AQID'`, or let a node publish numbers"
        )
    return "; single characters can't be read" if kind(static) == "text" else ""


def no_field(record: Record, name: str) -> str:
    """What to say of a field that a message does not have."""
    hint = no_constant(name) or nearest(name, record.fields)
    hint = f"{hint};" if hint and not hint.endswith("?") else hint
    return f"{described(record)} has no field `{name}`; {f'{hint} ' if hint else ''}{fields_of(record)}"


def fields_of(record: Record) -> str:
    """The fields of a message in words."""
    names = list(record.fields)
    if not names:
        return "it has no fields"
    more = f" and {len(names) - _FIELDS} more" if len(names) > _FIELDS else ""
    return f"it has {', '.join(names[:_FIELDS])}{more}"
