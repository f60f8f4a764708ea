"""What stands at a path of a message, by the message's shape."""

from __future__ import annotations

from oracle_server.core.expression import FieldPath, no_field
from oracle_server.core.shapes import Many, Record, Shape, Unknown, Value


def lacking(shape: Shape | None, path: FieldPath) -> str:
    """Why a message of this shape has nothing at a path, empty where it has."""
    for i, name in enumerate(path):
        before = "`msg`" if i == 0 else f"`{'.'.join(path[:i])}`"
        if isinstance(shape, Record):
            if name not in shape.fields:
                return no_field(shape, name)
            shape = shape.fields[name]
        elif isinstance(shape, Many):
            left_out = "leave `stamp` out, and the time that the middleware knows counts"
            return f"{before} is a list, and a stamp names no item of one; {left_out}"
        elif isinstance(shape, Value):
            return f"{before} is of the type {shape.type}, and has no field '{name}'"
        else:
            break
    return ""


def at(shape: Shape, path: FieldPath) -> Shape | None:
    """What stands at a path, None where nothing does; of a part that is not known that is the part itself."""
    for name in path:
        if isinstance(shape, Unknown):
            return shape
        if not isinstance(shape, Record) or name not in shape.fields:
            return None
        shape = shape.fields[name]
    return shape
