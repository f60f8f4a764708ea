"""Properties of HPL as a tree of immutable nodes; `at` is where a node begins in the text, `end` where it ends."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Literal

from oracle_server.core.errors import OracleError


class HplError(OracleError):
    """A file of HPL that can't be read, with its place."""


class NoCounterpartError(OracleError):
    """What has no counterpart in a spec, and at which character it begins."""

    def __init__(self, message: str, at: int) -> None:
        super().__init__(message)
        self.message, self.at = message, at


@dataclass(frozen=True, slots=True)
class Node:
    """A part of a predicate; two are equal that say the same, wherever they stand."""

    at: int = field(compare=False)
    end: int = field(compare=False)


@dataclass(frozen=True, slots=True)
class Number(Node):
    """A number as it is written."""

    text: str


@dataclass(frozen=True, slots=True)
class Text(Node):
    """A text without its quotes."""

    value: str


@dataclass(frozen=True, slots=True)
class Truth(Node):
    """`True` or `False`."""

    value: bool


@dataclass(frozen=True, slots=True)
class Constant(Node):
    """`PI`, `E`, `INF` or `NAN`."""

    name: str


@dataclass(frozen=True, slots=True)
class Reference(Node):
    """A field of the message that is looked at, or of `@alias`: names, and elements by their index."""

    alias: str
    steps: tuple[str | Expr, ...]


@dataclass(frozen=True, slots=True)
class Group(Node):
    """`{a, b}`."""

    items: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Range(Node):
    """`[low to high]`; `![` and `]!` leave an end out."""

    low: Expr
    high: Expr
    above: bool
    below: bool


@dataclass(frozen=True, slots=True)
class Call(Node):
    """A function of values."""

    name: str
    arguments: tuple[Expr, ...]


@dataclass(frozen=True, slots=True)
class Unary(Node):
    """`not a` or `-a`."""

    sign: Literal["not", "-"]
    operand: Expr


@dataclass(frozen=True, slots=True)
class Binary(Node):
    """Two operands, joined by a sign or word of HPL."""

    sign: str
    left: Expr
    right: Expr


@dataclass(frozen=True, slots=True)
class Quantified(Node):
    """`forall x in …: …` or `exists x in …: …`; the variable is `@x` within."""

    word: str
    variable: str
    domain: Expr
    body: Expr


Expr = Number | Text | Truth | Constant | Reference | Group | Range | Call | Unary | Binary | Quantified


@dataclass(frozen=True, slots=True)
class Event:
    """A message on a topic, whose name is that of a node's own where it begins with `~`; `alias` may be empty."""

    topic: str
    alias: str
    predicate: Expr | None
    at: int


Events = tuple[Event, ...]
"""An event, or several of which any counts."""


@dataclass(frozen=True, slots=True)
class Property:
    """A property: its scope by the events that open and close it, and its pattern."""

    verb: str
    behaviour: Events
    trigger: Events
    opens: Events
    closes: Events
    within: int | None
    """Nanoseconds, or None."""
    id: str
    title: str
    description: str
    text: str
    at: int

    def events(self) -> Iterator[Event]:
        """All events in it, as they stand in the text."""
        yield from sorted((*self.opens, *self.closes, *self.trigger, *self.behaviour), key=lambda event: event.at)


def below(expr: Expr) -> tuple[Expr, ...]:
    """What an expression is made of."""
    found: tuple[Expr, ...] = ()
    match expr:
        case Reference():
            found = tuple(step for step in expr.steps if not isinstance(step, str))
        case Group():
            found = expr.items
        case Range():
            found = (expr.low, expr.high)
        case Call():
            found = expr.arguments
        case Unary():
            found = (expr.operand,)
        case Binary():
            found = (expr.left, expr.right)
        case Quantified():
            found = (expr.domain, expr.body)
        case _:
            pass
    return found


def referred(expr: Expr, bound: frozenset[str] = frozenset()) -> Iterator[str]:
    """The aliases of messages in an expression, empty for the message itself; a quantifier's variable is none."""
    if isinstance(expr, Reference) and expr.alias not in bound:
        yield expr.alias
    for each in below(expr):
        inside = isinstance(expr, Quantified) and each is expr.body
        yield from referred(each, bound | {expr.variable} if inside and isinstance(expr, Quantified) else bound)
