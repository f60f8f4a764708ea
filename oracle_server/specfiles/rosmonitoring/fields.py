"""The fields of a message as values: of a known type where the message's shape is known, of any type elsewhere."""

from __future__ import annotations

from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value
from oracle_server.specfiles.rosmonitoring import values
from oracle_server.specfiles.rosmonitoring.cel import field, has
from oracle_server.specfiles.rosmonitoring.values import Const, Field, Key, Leaf, Raises, Term, UntranslatableError


def at(path: tuple[Key, ...], shape: Shape | None, widest: Shape | None = None) -> Leaf:
    """What stands at a path, whose value is of this shape; `widest` has what other versions of ROS have there, too."""
    match shape:
        case Value(kind="bool"):
            return Term(field(path), "bool", tight=True)
        case Value(kind="whole"):
            return Term(field(path), "number", tight=True, whole=True)
        case Value(kind="real"):
            return Term(field(path), "number", tight=True, whole=None)
        case Value(kind="text"):
            return Term(field(path), "text", tight=True)
        case Unknown():
            return Field(path)
    return Field(path, shape, widest or shape)


def member(whole: Field, key: str | int) -> Leaf:
    """A field of a field by its name, or an element of a list. Raises `UntranslatableError`."""
    path = (*whole.path, key)
    match whole.shape, key:
        case Record(fields=fields), str() if key in fields:
            return at(path, fields[key], _wider(whole, key))
        case Record(), str():
            return Field(path) if _wider(whole, key) is not None else Raises(f"KeyError: '{key}'")
        case Many(of=of, length=length), int():
            if length is not None and not -length <= key < length:
                return Raises("IndexError")
            return at(path, of, whole.widest.of if isinstance(whole.widest, Many) else None)
        case None, _:
            return Field(path)
        case ((Record() | Many()), _):
            return Raises("TypeError")
    raise UntranslatableError


def there(whole: Field, key: str) -> values.Value:
    """Whether a field has a field, which its shape decides where that is known. Raises `UntranslatableError`."""
    match whole.shape:
        case Record(fields=fields) if key in fields:
            return Const(True)
        case Record() if _wider(whole, key) is None:
            return Const(False)
        case Record() | None:
            return has((*whole.path, key))
    raise UntranslatableError


def _wider(whole: Field, key: str) -> Shape | None:
    return whole.widest.fields.get(key) if isinstance(whole.widest, Record) else None
