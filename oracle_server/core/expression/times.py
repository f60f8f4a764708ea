"""Times in messages, which are whole seconds and nanoseconds: how they are read as one number."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from oracle_server.core.expression.tree import Call, Chain, Field, Node, Path

_SECONDS = ("sec", "secs")
_NANOSECONDS = ("nanosec", "nsecs")


def single(text: str, fields: Collection[str]) -> str:
    """What to write for a part of a message with these fields where one value is wanted."""
    seconds, nanoseconds = (next((n for n in names if n in fields), None) for names in (_SECONDS, _NANOSECONDS))
    if seconds and nanoseconds:
        return f"write its seconds as a number, `{text}.{seconds} + {text}.{nanoseconds} / 1e9`"
    return f"write one of its fields, such as `{text}.{next(iter(fields))}`"


def mixed(chain: Chain, text: str) -> Iterator[tuple[int, str]]:
    """Nanoseconds that are added to seconds as they are, each with its place; `text` is the whole expression's."""
    sums = [chain.first, *(part for mark, part in chain.rest if mark in "+-")]
    if any(_name(part) in _SECONDS for part in sums):
        for part in sums:
            if _name(part) in _NANOSECONDS:
                own = text[part.start : part.end]
                yield part.start, f"`{own}` counts nanoseconds, and stands in a sum of seconds; write `{own} / 1e9`"


def _name(node: Node) -> str:
    """The last name of a field that is read, as it is or as a number of another kind."""
    match node:
        case Path(names=(*_, last)):
            return last
        case Field(name=name):
            return name
        case Call(name="double" | "int", arguments=(argument,)):
            return _name(argument)
        case _:
            return ""
