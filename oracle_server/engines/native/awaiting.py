"""An obligation as nodes: what is awaited as nodes that wait, on top of the nodes of the parts that only look back."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Obligation, Path, looks_ahead
from oracle_server.core.formula.tree import Atom, Formula
from oracle_server.engines.native.body import Body
from oracle_server.engines.native.eventually import Eventually
from oracle_server.engines.native.expressions import Expression, negated
from oracle_server.engines.native.guarded import SomeGuarded
from oracle_server.engines.native.joined import Joined, Leaf, Next, Reading
from oracle_server.engines.native.keys import Key
from oracle_server.engines.native.obligations import Obligations
from oracle_server.engines.native.some import Some
from oracle_server.engines.native.timeline import Timeline
from oracle_server.engines.native.until import Until
from oracle_server.engines.native.waiting import FALSE, TRUE, Awaited, Present

Scope = Mapping[str, int]


@dataclass(slots=True)
class Goals:
    """Makes nodes of what is awaited.

    `express` makes one of a part that only looks back, `places` are the atoms' among the formula's.
    """

    timeline: Timeline
    present: Present
    express: Callable[[Formula, Scope, Path], Expression]
    places: Mapping[Atom, int]
    scope: Scope
    leaves: list[Leaf] = field(default_factory=list)
    waiting: list[Eventually | Until] = field(default_factory=list)

    def node(self, formula: Formula, path: Path) -> Awaited:  # noqa: PLR0911 -- a case a node
        """A part of what is awaited."""
        if not looks_ahead(formula):
            return self.leaf(formula, self.express(formula, self.scope, path))
        match formula:
            case tree.And(left, right):
                return self._joined(left, right, path, FALSE)
            case tree.Or(left, right):
                return self._joined(left, right, path, TRUE)
            case tree.Implies(left, right):
                denied = self.leaf(left, negated(self.express(left, self.scope, (*path, 0))))
                return Joined(self.present, denied, self.node(right, (*path, 1)), absorbing=TRUE)
            case tree.Next(operand):
                return Next(self.present, self.node(operand, (*path, 0)))
            case tree.Eventually(operand, bound) | tree.Always(operand, bound):
                dual = isinstance(formula, tree.Always)
                node = Eventually(self.present, self.node(operand, (*path, 0)), bound, dual=dual)
                self.waiting.append(node)
                return node
            case tree.Until(left, right, bound):
                sides = self.node(left, (*path, 0)), self.node(right, (*path, 1))
                until = Until(self.present, *sides, bound)
                self.waiting.append(until)
                return until
        raise AssertionError(formula)  # `check_ahead` lets no other pass

    def leaf(self, formula: Formula, expression: Expression) -> Leaf:
        """A part that only looks back, as an expression."""
        reads: dict[int, Reading] = {}
        for atom, variables in _reads(formula, self.scope):
            known, _ = reads.setdefault(self.places[atom], (variables, limits_of(atom, self.scope)))
            both = tuple([v if v == w else 0 for v, w in zip(variables, known, strict=True)])
            reads[self.places[atom]] = both, limits_of(atom, self.scope)
        leaf = Leaf(Body(self.timeline, expression), len(self.scope), reads)
        self.leaves.append(leaf)
        return leaf

    def _joined(self, left: Formula, right: Formula, path: Path, absorbing: int) -> Awaited:
        sides = self.node(left, (*path, 0)), self.node(right, (*path, 1))
        return Joined(self.present, *sides, absorbing=absorbing)


def obligations(found: Obligation, goals: Goals, some: Callable[[Expression], Some | SomeGuarded]) -> Obligations:
    """The node of an obligation; `some` makes an operator of what is true for some values of the variables."""
    goal = goals.node(found.goal, found.goal_path)
    leaves, losing, trigger = [*goals.leaves], None, _always
    if found.trigger is not None:
        expression = goals.express(found.trigger, goals.scope, found.trigger_path)
        losing = goals.leaf(found.trigger, expression)
        if found.variables:
            quantified = some(expression)
            trigger = partial(quantified.keys, ())
        else:
            trigger = partial(_where, Body(goals.timeline, expression).at[0])
    return Obligations(found.variables, goals.present, trigger, losing, goal, leaves, goals.waiting)


def limits_of(atom: Atom, scope: Scope) -> tuple[tuple[str, int], ...]:
    """How an atom compares with variables, and with which ones."""
    return tuple((c.op, scope[c.value.name]) for c in atom.limits if isinstance(c.value, tree.Limit))


def _always() -> Collection[Key]:
    return ((),)


def _where(at: Callable[[Key], bool]) -> Collection[Key]:
    return ((),) if at(()) else ()


def _reads(formula: Formula, scope: Scope) -> Iterator[tuple[Atom, tuple[int, ...]]]:
    """The atoms of a part, each with the variables at its refs, 0 for one that is bound within."""
    if isinstance(formula, Atom):
        yield formula, tuple([scope.get(name, 0) for _, name in formula.refs])
    inner = scope
    if isinstance(formula, tree.Exists | tree.Forall):
        inner = {name: number for name, number in scope.items() if name != formula.variable}
    for child in tree.children(formula):
        yield from _reads(child, inner)
