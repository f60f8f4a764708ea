"""An expression as a tree of immutable nodes, each with its place in the text: `start` and `end`, from 0."""

from __future__ import annotations

import dataclasses
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

Key = Hashable
"""A part of an expression, without its place."""
_PLACES = frozenset({"start", "end", "place", "places"})


@dataclass(frozen=True, slots=True)
class Literal:
    """A value that is written out."""

    value: str | float | bool | None
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Path:
    """A field of the message by the names that lead to it, none for the message itself; `places` are the names' own."""

    names: tuple[str, ...]
    places: tuple[int, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Variable:
    """The variable of a comprehension."""

    name: str
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Field:
    """A field of something else than the message: of a variable, or of an element; the name begins at `place`."""

    of: Node
    name: str
    place: int
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Index:
    """`of[index]`."""

    of: Node
    index: Node
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Unary:
    """`!of` or `-of`."""

    mark: str
    of: Node
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Chain:
    """Arithmetic of one rank, from left to right: `first`, then pairs of a mark and an operand."""

    first: Node
    rest: tuple[tuple[str, Node], ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Compare:
    """A comparison, or `left in right`."""

    mark: str
    left: Node
    right: Node
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Joined:
    """Operands between `&&`, or between `||`."""

    mark: str
    parts: tuple[Node, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Choice:
    """`test ? value : test ? value : … : otherwise`."""

    cases: tuple[tuple[Node, Node], ...]
    otherwise: Node
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Call:
    """A function of values; a text's or a list's own is one whose first argument stands before the dot."""

    name: str
    arguments: tuple[Node, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Has:
    """Whether a field is there."""

    of: Path | Field | Index
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class Loop:
    """A comprehension: `of.kind(variable, body)`; `map` may take only elements at which `when` holds."""

    kind: str
    of: Node
    variable: str
    body: Node
    when: Node | None
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list that is written out."""

    items: tuple[Node, ...]
    start: int
    end: int


@dataclass(frozen=True, slots=True)
class MapOf:
    """Values by texts, written out."""

    keys: tuple[str, ...]
    values: tuple[Node, ...]
    start: int
    end: int


Node = (
    Literal
    | Path
    | Variable
    | Field
    | Index
    | Unary
    | Chain
    | Compare
    | Joined
    | Choice
    | Call
    | Has
    | Loop
    | ListOf
    | MapOf
)


def children(node: Node) -> tuple[Node, ...]:  # noqa: PLR0911 -- a case a kind of nodes
    """The nodes directly under a node, in the order of the text."""
    match node:
        case Field(of=of) | Unary(of=of) | Has(of=of):
            return (of,)
        case Index(of=of, index=index):
            return (of, index)
        case Chain(first=first, rest=rest):
            return (first, *(operand for _, operand in rest))
        case Compare(left=left, right=right):
            return (left, right)
        case Joined(parts=parts) | Call(arguments=parts) | ListOf(items=parts) | MapOf(values=parts):
            return parts
        case Choice(cases=cases, otherwise=otherwise):
            return (*(part for case in cases for part in case), otherwise)
        case Loop(of=of, body=body, when=when):
            return (of, body) if when is None else (of, when, body)
        case _:
            return ()


def walk(node: Node) -> list[Node]:
    """A node and all under it."""
    found = [node]
    for each in found:
        found += children(each)
    return found


def key_of(node: Any) -> Key:
    """A part of an expression without its places, so that parts are compared by what they say."""
    if isinstance(node, tuple):
        return tuple(key_of(each) for each in node)
    if not dataclasses.is_dataclass(node):
        return type(node).__name__, node
    fields = [f.name for f in dataclasses.fields(node) if f.name not in _PLACES]
    return type(node).__name__, *(key_of(getattr(node, name)) for name in fields)
