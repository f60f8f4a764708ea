"""The tree of a formula. Every node is an immutable value; where it stood in the text does not count as part of it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Literal

Position = tuple[int, int]
"""Line and column in the formula's text, both from 1."""

Time = Literal["steps", "seconds"]
"""What bounds count."""
NANOSECONDS = {"ns": 1, "us": 10**3, "ms": 10**6, "s": 10**9, "min": 60 * 10**9, "h": 3600 * 10**9}
"""What the units of bounds are, and of all durations."""
Scalar = str | bool | int | float
Op = Literal["==", "!=", "<", "<=", ">", ">="]


class Any(Enum):
    """The value of a constraint that any present value meets: `{key: *}`."""

    ANY = "*"


@dataclass(frozen=True, slots=True)
class Ref:
    """A quantified variable in a constraint: `{key: *name}`."""

    name: str


@dataclass(frozen=True, slots=True)
class Signal:
    """The value of another signal at the same step, with which a constraint compares: `{key > name}`."""

    name: str


@dataclass(frozen=True, slots=True)
class Limit:
    """A quantified variable with whose value a constraint compares: `{key > *name}`."""

    name: str


@dataclass(frozen=True, slots=True, eq=False)
class Constraint:
    """One `key op value` of an atom; `a: 1` and `a: true` are different, though Python's 1 and True are equal.

    `bare`: its value is a text that is written without quotes, which is no part of it.
    """

    key: str
    op: Op
    value: Scalar | Any | Ref | Signal | Limit
    bare: bool = False

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Constraint) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def _identity(self) -> tuple[object, ...]:
        return (self.key, self.op, isinstance(self.value, bool), self.value)


@dataclass(frozen=True, slots=True)
class Bound:
    """Distances from now, both ends included, back or, of what is awaited, ahead.

    They count judged events under `time: steps`, nanoseconds under `time: seconds`.
    """

    lower: int = 0
    upper: int | None = None


ALL_PAST = UNBOUNDED = Bound()


@dataclass(frozen=True, slots=True)
class Call:
    """A name of `define:` where it is used, and the variables that stand for its own."""

    name: str
    arguments: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.name}({', '.join(self.arguments)})" if self.arguments else self.name


@dataclass(frozen=True, slots=True)
class _Node:
    """What all nodes have: the name that stands for one in the text; it does not count as part of the formula."""

    written: Call | None = field(default=None, compare=False, repr=False, kw_only=True)


@dataclass(frozen=True, slots=True)
class Use:
    """A name where it stands in a text that is being read; no formula has any."""

    call: Call
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Atom(_Node):
    """`{k: v, …}`: holds where the step's signals meet every constraint; without any it is `true`.

    Of two signals that are compared both are there: `{v > limit}` has the constraint `limit: *` as well.
    """

    constraints: tuple[Constraint, ...]
    at: Position = field(default=(1, 1), compare=False)

    @property
    def refs(self) -> tuple[tuple[str, str], ...]:
        """The (key, variable) pairs that quantifiers bind, in their order."""
        return tuple((c.key, c.value.name) for c in self.constraints if isinstance(c.value, Ref))

    @property
    def limits(self) -> tuple[Constraint, ...]:
        """The constraints that compare with the values of variables, which something else binds."""
        return tuple(c for c in self.constraints if isinstance(c.value, Limit))

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables that it binds, and those that it compares with."""
        return tuple(c.value.name for c in self.constraints if isinstance(c.value, Ref | Limit))


@dataclass(frozen=True, slots=True, eq=False)
class Relation(_Node):
    """`*x < *y`, `*x == 3`: how the values of variables compare, which something else binds.

    A variable stands on its left; values stand there only where something is told of some. As constraints are,
    `*x == 1` and `*x == true` are different.
    """

    left: Ref | Scalar
    op: Op
    right: Ref | Scalar
    at: Position = field(default=(1, 1), compare=False)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Relation) and self._identity == other._identity

    def __hash__(self) -> int:
        return hash(self._identity)

    @property
    def variables(self) -> tuple[str, ...]:
        """The variables whose values it compares."""
        return tuple(side.name for side in (self.left, self.right) if isinstance(side, Ref))

    @property
    def _identity(self) -> tuple[object, ...]:
        return (self.op, *((isinstance(side, bool), side) for side in (self.left, self.right)))


@dataclass(frozen=True, slots=True)
class Not(_Node):
    """`not φ`."""

    operand: Formula


@dataclass(frozen=True, slots=True)
class And(_Node):
    """`φ and ψ`."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Or(_Node):
    """`φ or ψ`."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Implies(_Node):
    """`φ -> ψ`."""

    left: Formula
    right: Formula


@dataclass(frozen=True, slots=True)
class Pre(_Node):
    """`pre φ`: there is a step before this one and φ held there."""

    operand: Formula


@dataclass(frozen=True, slots=True)
class Once(_Node):
    """`once[a:b] φ`."""

    operand: Formula
    bound: Bound = ALL_PAST


@dataclass(frozen=True, slots=True)
class Historically(_Node):
    """`historically[a:b] φ`."""

    operand: Formula
    bound: Bound = ALL_PAST


@dataclass(frozen=True, slots=True)
class Since(_Node):
    """`φ since[a:b] ψ`."""

    left: Formula
    right: Formula
    bound: Bound = ALL_PAST


@dataclass(frozen=True, slots=True)
class Exists(_Node):
    """`exists[x]. φ`, over all values: those seen so far and those not seen yet."""

    variable: str
    body: Formula
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Forall(_Node):
    """`forall[x]. φ`, over all values: those seen so far and those not seen yet."""

    variable: str
    body: Formula
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Next(_Node):
    """`next φ`: φ holds at the step after this one."""

    operand: Formula
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Eventually(_Node):
    """`eventually[a:b] φ`."""

    operand: Formula
    bound: Bound = UNBOUNDED
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Always(_Node):
    """`always[a:b] φ`."""

    operand: Formula
    bound: Bound = UNBOUNDED
    at: Position = field(default=(1, 1), compare=False)


@dataclass(frozen=True, slots=True)
class Until(_Node):
    """`φ until[a:b] ψ`."""

    left: Formula
    right: Formula
    bound: Bound = UNBOUNDED
    at: Position = field(default=(1, 1), compare=False)


Formula = (
    Atom
    | Relation
    | Not
    | And
    | Or
    | Implies
    | Pre
    | Once
    | Historically
    | Since
    | Exists
    | Forall
    | Next
    | Eventually
    | Always
    | Until
)


def demanded(constraints: Sequence[Constraint]) -> tuple[Constraint, ...]:
    """That the signals are there with which others are compared, where nothing else asks for them."""
    keys = {c.key for c in constraints}
    others = dict.fromkeys(c.value.name for c in constraints if isinstance(c.value, Signal))
    return tuple(Constraint(name, "==", Any.ANY) for name in others if name not in keys)


TRUE = Atom(())
"""`true`: holds at every step."""
FALSE = Not(TRUE)
"""`false`: holds at none."""
STEP = Atom((Constraint("kind", "==", Any.ANY),))
"""Holds at every step, and not at a deadline, which is no event of any kind."""
FIRST = And(STEP, Not(Pre(TRUE)))
"""`first`: there is no step before; not at a deadline, which is no event of any kind."""
WORDS = {"true": TRUE, "false": FALSE, "first": FIRST}
"""The formulas that are written as a word."""


def word_of(formula: Formula) -> str | None:
    """The word that a formula is written as, None for most."""
    return next((word for word, meant in WORDS.items() if meant == formula), None)


def lasting(operand: Formula, distance: int) -> Formula:
    """`lasting[d] φ`: φ held at a step at least d ago, and ever since."""
    return Since(operand, operand, Bound(distance))


def lasted(node: Formula) -> tuple[Formula, int] | None:
    """What has lasted, and for how long, where a formula says that; None for any other."""
    match node:
        case Since(left, right, Bound(int(lower), None)) if lower and left == right:
            return right, lower
    return None


def children(node: Formula) -> tuple[Formula, ...]:
    """The direct sub-formulas of a node, from left to right."""
    match node:
        case Atom() | Relation():
            return ()
        case Not(operand) | Pre(operand) | Once(operand) | Historically(operand):
            return (operand,)
        case Next(operand) | Eventually(operand) | Always(operand):
            return (operand,)
        case And(left, right) | Or(left, right) | Implies(left, right) | Since(left, right) | Until(left, right):
            return (left, right)
        case Exists(_, body) | Forall(_, body):
            return (body,)


def rebuilt(node: Formula, change: Callable[[Formula], Formula]) -> Formula:
    """A new node like this one, with each of its direct sub-formulas changed."""
    match node:
        case Atom() | Relation():
            return replace(node)
        case Not(operand) | Pre(operand) | Once(operand) | Historically(operand):
            return replace(node, operand=change(operand))
        case Next(operand) | Eventually(operand) | Always(operand):
            return replace(node, operand=change(operand))
        case And(left, right) | Or(left, right) | Implies(left, right) | Since(left, right) | Until(left, right):
            return replace(node, left=change(left), right=change(right))
        case Exists(_, body) | Forall(_, body):
            return replace(node, body=change(body))


def walk(formula: Formula) -> Iterator[Formula]:
    """Every node of a formula, itself first, from left to right."""
    stack = [formula]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(children(node)))


def atoms(formula: Formula) -> tuple[Atom, ...]:
    """The different atoms of a formula, each once, in the order of their first appearance."""
    return tuple(dict.fromkeys(node for node in walk(formula) if isinstance(node, Atom)))
