"""The names of `define:`, and formulas with names in them written out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula.size import Size, measured
from oracle_server.core.formula.tree import (
    Always,
    Atom,
    Call,
    Constraint,
    Eventually,
    Exists,
    Forall,
    Formula,
    Limit,
    Next,
    Position,
    Ref,
    Relation,
    Time,
    Until,
    Use,
    children,
    rebuilt,
    walk,
)

MOST_WRITTEN_OUT = 500_000
"""Parts that the names of one spec may stand for, wherever they are used."""


@dataclass(frozen=True, slots=True)
class Named:
    """What a name stands for: with each clock a formula, written out, or why there is none.

    `call` has its variables, and `head` both as they are written.
    """

    head: str
    call: Call
    bodies: Mapping[Time, Formula | FormulaError]

    @property
    def broken(self) -> bool:
        """Whether it can't be read with either clock."""
        return all(isinstance(body, FormulaError) for body in self.bodies.values())


@dataclass(slots=True)
class Names:
    """The names of a spec, as far as they are defined; `used` are those that something used.

    While one is `reading`, it and those `below` it can't be used. `left` is how many parts names may still stand for.
    """

    known: dict[str, Named] = field(default_factory=dict)
    reading: str = ""
    below: frozenset[str] = frozenset()
    used: set[str] = field(default_factory=set)
    left: int = MOST_WRITTEN_OUT

    def body(self, use: Use, time: Time) -> Formula:
        """What a name stands for where it is used. Raises `FormulaError`, at its place."""
        call = use.call
        self.used.add(call.name)
        named = self.known[call.name]
        if len(named.call.arguments) != len(call.arguments):
            raise FormulaError(f"`{call}` has not the variables that it is defined with: write `{named.call}`", *use.at)
        found = named.bodies[time]
        if isinstance(found, FormulaError):
            reason = f"`{call.name}` can't be used with `time: {time}`: {found.message}"
            raise FormulaError(reason, *use.at, told=named.broken)
        return found


def written_out(formula: Formula, used: Sequence[Use], names: Names, time: Time) -> Formula:
    """The formula with what the names `used` in it stand for, each of its parts an object of its own.

    Raises `FormulaError` where a name can't be used as it is, or the formula is too large.
    """
    bodies = {id(use): names.body(use, time) for use in used}
    sizes = {id(body): measured(body, _no_size)[0] for body in {id(body): body for body in bodies.values()}.values()}
    size, objects = measured(formula, lambda use: sizes[id(bodies[id(use)])])
    if not used and size.parts == objects:
        return formula
    names.left -= size.parts
    if names.left < 0:
        raise FormulaError(f"the names of this spec stand for more than {MOST_WRITTEN_OUT:,} parts in all")

    def out(node: Formula | Use) -> Formula:
        if not isinstance(node, Use):
            return rebuilt(node, out)
        values = dict(zip(names.known[node.call.name].call.arguments, node.call.arguments, strict=True))
        return replace(_instance(bodies[id(node)], values, node.at), written=node.call)

    return out(formula)


def uses(formula: Formula) -> Iterator[Use]:
    """The names in a formula, whose parts may be shared: each is looked at once."""
    seen: set[int] = set()
    waiting: list[Formula | Use] = [formula]
    while waiting:
        node = waiting.pop()
        if id(node) in seen:
            continue
        seen.add(id(node))
        if isinstance(node, Use):
            yield node
        else:
            waiting += children(node)


def _no_size(use: Use) -> Size:
    raise FormulaError(f"`{use.call}` is not written out", *use.at)


def _instance(node: Formula, values: Mapping[str, str], at: Position) -> Formula:
    """A body where its name is used: with other variables for its own, and all of it at that place."""
    call = node.written
    written = call and Call(call.name, tuple(values.get(name, name) for name in call.arguments))
    match node:
        case Atom(constraints):
            return replace(node, constraints=tuple(_renamed(c, values) for c in constraints), at=at, written=written)
        case Relation(left, _, right):
            sides = [Ref(values.get(s.name, s.name)) if isinstance(s, Ref) else s for s in (left, right)]
            return replace(node, left=sides[0], right=sides[1], at=at, written=written)
        case Exists(variable, body) | Forall(variable, body):
            inner = {name: value for name, value in values.items() if name != variable}
            if variable in inner.values():  # it would bind what is not meant
                inner[variable] = variable = _fresh(variable, body, inner)
            return replace(node, variable=variable, body=_instance(body, inner, at), at=at, written=written)
        case Next() | Eventually() | Always() | Until():
            return rebuilt(replace(node, at=at, written=written), lambda part: _instance(part, values, at))
        case _:
            return replace(rebuilt(node, lambda part: _instance(part, values, at)), written=written)


def _renamed(constraint: Constraint, values: Mapping[str, str]) -> Constraint:
    value = constraint.value
    if not isinstance(value, Ref | Limit):
        return constraint
    return Constraint(constraint.key, constraint.op, type(value)(values.get(value.name, value.name)))


def _fresh(variable: str, body: Formula, values: Mapping[str, str]) -> str:
    """A name like this one that nothing in a body has, nor any of its variables gets."""
    taken = {*values.values()}
    for node in walk(body):
        if isinstance(node, Atom | Relation):
            taken.update(node.variables)
        elif isinstance(node, Exists | Forall):
            taken.add(node.variable)
    return next(name for i in range(2, len(taken) + 3) if (name := f"{variable}{i}") not in taken)
