"""What a Python expression may be worth: a tree of choices, whose leaves are known or are CEL."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal

from oracle_server.core.errors import OracleError
from oracle_server.core.shapes import Shape

MAX_LEAVES = 256
"""Most leaves of one value: each `if` in the way doubles them."""


class UntranslatableError(OracleError):
    """Python that has no plain counterpart in CEL."""


class UnfollowableError(UntranslatableError):
    """A statement whose effect on the predicates is not known."""


class Variable(str):
    """A variable of a comprehension, at the beginning of a path in place of the message."""

    __slots__ = ()


Key = str | int
"""A part of a path: a name, or the number of an element, from the end where it is negative."""


class Name(str):
    """A topic's or service's name, which equals others with and without the leading slash."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class Const:
    """A value that is known: a constant, or a list, tuple, set or dict of constants."""

    value: object


@dataclass(frozen=True, slots=True)
class Term:
    """CEL of a known type. `tight` ones need no parentheses.

    `whole` says of a number whether CEL has it as a whole one, None where that depends on how a real field was written.
    """

    text: str
    kind: Literal["bool", "number", "text"]
    tight: bool = False
    whole: bool | None = False


@dataclass(frozen=True, slots=True)
class Field:
    """A field of the message that is no single value of a known type; `shape` is what is known of it.

    `widest` has also what other versions of ROS have there.
    """

    path: tuple[Key, ...]
    shape: Shape | None = field(default=None, compare=False, repr=False)
    widest: Shape | None = field(default=None, compare=False, repr=False)


@dataclass(frozen=True, slots=True)
class Items:
    """A list, tuple or set with items that are not all constants."""

    values: tuple[Value, ...]


@dataclass(frozen=True, slots=True)
class Table:
    """A dict made by the function, with constant keys."""

    values: tuple[tuple[str, Value], ...]


@dataclass(frozen=True, slots=True)
class Message:
    """The function's argument."""


@dataclass(frozen=True, slots=True)
class Predicates:
    """The module's dictionary `predicates`."""


@dataclass(frozen=True, slots=True)
class Kept:
    """What a predicate was worth before this message."""

    name: str


@dataclass(frozen=True, slots=True)
class Raises:
    """The function fails here; `stated` is a `raise` or an `assert` of it, and no value that can't be reckoned."""

    error: str
    stated: bool = False


@dataclass(frozen=True, slots=True)
class Unread:
    """Python that could not be translated; `shares` is what may change in its value."""

    python: str
    shares: frozenset[Ref] = frozenset()


@dataclass(frozen=True, slots=True)
class Function:
    """A function of the module, and its parameters' defaults, which Python reckons where the function stands.

    `cached` is one that is called only with arguments that can be keys of a dict.
    """

    node: ast.FunctionDef
    defaults: Mapping[str, Value] = field(default_factory=dict)
    cached: bool = False


@dataclass(frozen=True, slots=True)
class Imported:
    """What another module has: its name, or `module.name`."""

    name: str


@dataclass(frozen=True, slots=True)
class Choice:
    """One value where the Boolean `test` holds, another where not."""

    test: Term
    yes: Value
    no: Value


Leaf = Const | Term | Field | Items | Table | Message | Predicates | Kept | Raises | Unread | Function | Imported
Value = Leaf | Choice


class Thing:
    """A list, set or dict, by its identity."""

    __slots__ = ("_itself",)

    def __init__(self, itself: object) -> None:
        self._itself = itself

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Thing) and self._itself is other._itself

    def __hash__(self) -> int:
        return id(self._itself)

    def __repr__(self) -> str:
        return f"Thing({id(self._itself)})"


Ref = Thing | Message | Field | Predicates
"""What may change where somebody has it: also the message, what is under one of its keys, and `predicates`."""


def same(left: Value, right: Value) -> bool:
    """Whether two values are one; 1 and True are not, and neither are two lists that are alike."""
    return repr(left) == repr(right) and set(shared(left)) == set(shared(right))


def choice(test: Value, yes: Value, no: Value) -> Value:
    """The value by a Boolean tree. Raises `UntranslatableError` where the tree is no test, or it grows too large."""
    if same(yes, no):
        return yes
    match test:
        case Choice(inner, if_yes, if_no):
            return checked(choice(inner, choice(if_yes, yes, no), choice(if_no, yes, no)))
        case Const(value):
            return yes if value else no
        case Term(kind="bool"):
            yes, no = _assuming(yes, test, holds=True), _assuming(no, test, holds=False)
            return yes if same(yes, no) else checked(Choice(test, yes, no))
        case Raises():
            return test
    raise UntranslatableError


def _assuming(value: Value, test: Term, *, holds: bool) -> Value:
    """A tree below a test, which need not be asked again there."""
    if not isinstance(value, Choice):
        return value
    if value.test.text == test.text:
        return _assuming(value.yes if holds else value.no, test, holds=holds)
    yes, no = _assuming(value.yes, test, holds=holds), _assuming(value.no, test, holds=holds)
    return yes if same(yes, no) else Choice(value.test, yes, no)


def each(value: Value, change: Callable[[Leaf], Value]) -> Value:
    """The tree with each leaf changed."""
    if isinstance(value, Choice):
        return choice(value.test, each(value.yes, change), each(value.no, change))
    return value if isinstance(value, Raises) else change(value)


def leaves(value: Value) -> list[Leaf]:
    """All leaves of a tree."""
    return [*leaves(value.yes), *leaves(value.no)] if isinstance(value, Choice) else [value]


def checked(value: Value) -> Value:
    """The value. Raises `UntranslatableError` where it has too many leaves."""
    if len(leaves(value)) > MAX_LEAVES:
        raise UntranslatableError
    return value


def shared(value: object) -> Iterator[Ref]:
    """What may change in a value: its lists, sets and dicts, and those inside of them; all under a key is one."""
    match value:
        case Const(known):
            yield from shared(known)
        case Choice(_, yes, no):
            yield from (*shared(yes), *shared(no))
        case Unread(_, shares):
            yield from shares
        case Function(_, defaults):
            yield from (ref for v in defaults.values() for ref in shared(v))
        case Message() | Predicates():
            yield value
        case Field(path):
            yield Field(path[:1]) if path else Message()
        case list() | set() | dict() | Items() | Table():
            yield Thing(value)
            yield from inside(value)
        case tuple():
            yield from inside(value)


def inside(value: object) -> Iterator[Ref]:
    """What may change in what is found by looking into a value: not the list itself, but its items."""
    match value:
        case Const(known):
            yield from inside(known)
        case Choice(_, yes, no):
            yield from (*inside(yes), *inside(no))
        case dict():
            yield from (ref for v in value.values() for ref in shared(v))
        case Table(named):
            yield from (ref for _, v in named for ref in shared(v))
        case list() | tuple() | set() | Items():
            yield from (ref for v in (value.values if isinstance(value, Items) else value) for ref in shared(v))
        case _:
            yield from shared(value)
