"""A formula as nodes: what engines are made of."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Obligation, Path, obligation
from oracle_server.core.formula.breach import Asked
from oracle_server.core.formula.relations import wanted
from oracle_server.core.formula.tree import Atom, Bound, Formula
from oracle_server.engines.native.awaiting import Goals, limits_of, obligations
from oracle_server.engines.native.body import Body
from oracle_server.engines.native.compared import ComparedNode
from oracle_server.engines.native.ever import Ever
from oracle_server.engines.native.expressions import (
    Expression,
    all_of,
    bound,
    conjuncts,
    is_finite,
    is_lasting,
    negated,
    nodes_of,
    unrelated,
    variables_of,
)
from oracle_server.engines.native.guarded import SomeGuarded, guard_of
from oracle_server.engines.native.latest import Latest
from oracle_server.engines.native.matching import Matching
from oracle_server.engines.native.nodes import AtomNode
from oracle_server.engines.native.obligations import Obligations
from oracle_server.engines.native.outstanding import Outstanding
from oracle_server.engines.native.preceded import Preceded
from oracle_server.engines.native.previous import Previous
from oracle_server.engines.native.related import RelationNode
from oracle_server.engines.native.some import Some, SomeOf
from oracle_server.engines.native.sought import SomeSought
from oracle_server.engines.native.timeline import Timeline
from oracle_server.engines.native.unbroken import Unbroken
from oracle_server.engines.native.waiting import Present
from oracle_server.engines.native.window import Window

Scope = Mapping[str, int]
"""The number of the quantifier that binds each variable: inner ones have larger numbers."""
Operator = (
    Ever
    | Latest
    | Window
    | Preceded
    | Unbroken
    | Outstanding
    | Matching
    | Previous
    | Some
    | SomeOf
    | SomeGuarded
    | SomeSought
    | Obligations
)


@dataclass(slots=True)
class Network:
    """The nodes of a formula: atoms with their places among the formula's, and operators, each after those below it."""

    timeline: Timeline
    atoms: list[tuple[int, AtomNode | ComparedNode]] = field(default_factory=list)
    operators: list[Operator] = field(default_factory=list)
    places: dict[Path, AtomNode | ComparedNode | RelationNode | Operator] = field(default_factory=dict)
    """The node of each part of the formula that has one; of quantifiers that follow each other, the first one."""
    scopes: dict[Path, Scope] = field(default_factory=dict)
    """What quantifiers bind in their bodies."""
    beside: dict[Path, Body] = field(default_factory=dict)
    """What must hold for the node of a quantifier to tell the truth of that."""
    obligations: Obligations | None = None
    """The last of the operators, where the formula waits for what comes."""
    root: Body = field(init=False)


def build(formula: Formula, timeline: Timeline) -> Network:
    """The nodes of a formula, before its first step."""
    network = Network(timeline)
    builder = _Builder(formula, network)
    found = obligation(formula)
    network.root = Body(timeline, builder.expression(formula, {}, ()) if found is None else builder.awaiting(found))
    return network


class _Builder:
    def __init__(self, formula: Formula, network: Network) -> None:
        self._network, self._timeline = network, network.timeline
        self._places = {atom: i for i, atom in enumerate(tree.atoms(formula))}
        self._atoms: dict[tuple[int, tuple[int, ...]], AtomNode | ComparedNode] = {}
        self._quantifiers = 0
        self._beside: tuple[Expression, ...] = ()
        """What holds, at the same step, wherever the part matters that is being made."""

    def expression(self, node: Formula, scope: Scope, path: Path) -> Expression:
        """A part of the formula, as nodes."""
        match node:
            case tree.Atom():
                return self._atom(node, scope, path)
            case tree.Relation():
                related = self._network.places[path] = RelationNode(node, scope.__getitem__)
                return related
            case tree.Exists():
                return self._some(node, scope, path)
            case tree.Forall():
                return negated(self._some(node, scope, path))
            case tree.Not() | tree.And() | tree.Or() | tree.Implies():
                return self._boolean(node, scope, path)
            case tree.Pre() | tree.Once() | tree.Historically() | tree.Since():
                beside, self._beside = self._beside, ()  # it is asked at other steps
                found = self._temporal(node, scope, path)
                self._beside = beside
                return found
            case _:
                raise AssertionError(node)  # what waits for what comes stands around what only looks back

    def awaiting(self, found: Obligation) -> Obligations:
        """An obligation, as the last operator."""
        scope = {name: number for number, name in enumerate(found.variables, 1)}
        self._quantifiers = len(scope)
        self._network.scopes[()] = scope
        goals = Goals(self._timeline, Present(self._timeline), self.expression, self._places, scope)
        made = self._network.obligations = obligations(found, goals, self._values)
        self._network.operators.append(made)
        return made

    def _values(self, operand: Expression) -> Some | SomeGuarded:
        """The values of all variables for which an expression holds."""
        guard = guard_of(operand, variables_of(operand))
        made = (
            Some(self._body(operand), self._timeline) if guard is None else SomeGuarded(guard, operand, self._timeline)
        )
        self._network.operators.append(made)
        return made

    def _boolean(self, node: tree.Not | tree.And | tree.Or | tree.Implies, scope: Scope, path: Path) -> Expression:
        match node:
            case tree.Not(operand):
                return negated(self.expression(operand, scope, (*path, 0)))
            case tree.And(left, right):
                first = self.expression(left, scope, (*path, 0))
                return ("and", first, self._where(first, right, scope, (*path, 1)))
            case tree.Or(left, right):
                first = self.expression(left, scope, (*path, 0))
                return ("or", first, self._where(negated(first), right, scope, (*path, 1)))
            case tree.Implies(left, right):
                first = self.expression(left, scope, (*path, 0))
                return ("or", negated(first), self._where(first, right, scope, (*path, 1)))

    def _where(self, holds: Expression, node: Formula, scope: Scope, path: Path) -> Expression:
        """A part that matters only where an expression holds."""
        beside, self._beside = self._beside, (*self._beside, holds)
        found = self.expression(node, scope, path)
        self._beside = beside
        return found

    def _temporal(
        self, node: tree.Pre | tree.Once | tree.Historically | tree.Since, scope: Scope, path: Path
    ) -> Expression:
        match node:
            case tree.Pre(operand):
                before = self._body(self.expression(operand, scope, (*path, 0)))
                return self._add(path, Previous(before, self._timeline))
            case tree.Once(operand, bound):
                clock = self._counted() if isinstance(node, Asked) else None
                return self._once(path, self.expression(operand, scope, (*path, 0)), bound, clock)
            case tree.Historically(operand, bound):
                return ("not", self._once(path, negated(self.expression(operand, scope, (*path, 0))), bound))
            case tree.Since(left, right, bound):
                sides = self.expression(right, scope, (*path, 1)), self.expression(left, scope, (*path, 0))
                return self._add(path, self._since(*sides, bound))

    def _since(self, right: Expression, left: Expression, bound: Bound) -> Latest | Unbroken | Window:
        if not bound.lower and is_finite(right):
            if {*variables_of(left)} <= {*variables_of(right)}:
                return Latest(self._body(right), Body(self._timeline, left), bound.upper, self._timeline)
            if is_finite(negated(left)):
                return Unbroken(self._body(right), self._body(negated(left)), bound.upper, self._timeline)
        return Window(Body(self._timeline, right, left), bound, self._timeline)

    def _atom(self, atom: Atom, scope: Scope, path: Path) -> AtomNode | ComparedNode:
        refs = tuple(scope[name] for _, name in atom.refs)
        limits = limits_of(atom, scope)
        place, variables = self._places[atom], (*refs, *(v for _, v in limits))
        node = self._atoms.get((place, variables))
        if node is None:
            known = tuple(sorted(set(variables)))
            node = ComparedNode(known, refs, limits) if limits else AtomNode(known, refs)
            self._atoms[place, variables] = node
            self._network.atoms.append((place, node))
        self._network.places[path] = node
        return node

    def _counted(self) -> Timeline | None:
        """The times at which steps count for what was asked; None where only their numbers do."""
        line = self._timeline
        if line.timed and line.counted is None:
            line.counted = Timeline(timed=True)
        return line.counted

    def _once(self, path: Path, operand: Expression, bound: Bound, clock: Timeline | None = None) -> Expression:
        finite = is_finite(operand)
        if finite and bound == tree.ALL_PAST:
            order = _order(operand)
            if order is not None:
                return self._add(path, Preceded(self._body(order[0]), self._body(order[1]), self._timeline))
        if bound.upper is None and (finite or not variables_of(operand)):
            return self._add(path, Ever(self._body(operand), bound.lower, self._timeline, clock))
        if not bound.lower and finite:
            return self._add(path, Latest(self._body(operand), None, bound.upper, self._timeline, clock))
        return self._add(path, Window(Body(self._timeline, operand), bound, self._timeline, clock))

    def _some(self, node: tree.Exists | tree.Forall, scope: Scope, path: Path) -> Expression:
        """A quantifier, and those of its kind that follow directly; for all is none for which not."""
        kind, part, inner, own = type(node), node, dict(scope), set[int]()
        body: Formula = node
        inside = path
        while isinstance(body, kind):
            part = body
            self._quantifiers += 1
            inner[part.variable] = self._quantifiers
            own.add(self._quantifiers)
            body = part.body
            inside = (*inside, 0)
        self._network.scopes[path] = inner
        operand = self.expression(body, inner, inside)
        if kind is tree.Forall:
            operand = negated(operand)
        operand = self._related(operand, {scope[name] for name in wanted(body)}, path)
        used = len(own.intersection(variables_of(operand)))
        if not used:
            return operand
        guard = guard_of(operand, variables_of(operand)) if used == len(variables_of(operand)) else None
        if guard is not None:
            return self._add(path, SomeGuarded(guard, operand, self._timeline))
        whole = self._body(operand)
        if used == len(whole.variables):
            return self._add(path, Some(whole, self._timeline))
        made = SomeOf(whole, used, self._timeline)
        beside = frozenset[int]().union(*map(bound, self._beside))
        if not made.flat and beside.issuperset(made.variables):
            return self._add(path, SomeSought(operand, used, self._timeline))
        return self._add(path, made)

    def _related(self, operand: Expression, outer: Set[int], path: Path) -> Expression:
        """A quantifier's body, with what binds those variables of its relations that it does not bind itself."""
        if not outer:
            return operand
        parts = [p for each in self._beside for p in conjuncts(each) if not outer.isdisjoint(variables_of(p))]
        self._network.beside[path] = Body(self._timeline, all_of(parts))
        return all_of([*parts, operand])

    def _body(self, operand: Expression) -> Body:
        """What stands under a node: where it binds all its variables, the keys at which it holds, found by joining."""
        body = Body(self._timeline, operand)
        if body.flat or not is_finite(operand):
            return body
        joined = Matching(self._narrowed(operand), self._timeline)
        self._network.operators.append(joined)
        return Body(self._timeline, joined)

    def _narrowed(self, operand: Expression) -> Expression:
        """The same, where pairs that a `Preceded` does not list are looked for among those that the rest holds for."""
        parts = conjuncts(operand)
        for place, part in enumerate(parts):
            if isinstance(part, Preceded) and len(part.began_variables) == 1:
                also = [p for p in parts if all(node.variables == part.began_variables for node in nodes_of(p))]
                if also:
                    parts[place] = Outstanding(part, all_of(also), self._timeline)
                    self._network.operators.append(parts[place])
        return all_of(parts)

    def _add(self, path: Path, operator: Operator) -> Operator:
        self._network.operators.append(operator)
        self._network.places[path] = operator
        return operator


def _order(operand: Expression) -> tuple[Expression, Expression] | None:
    """Two parts of a conjunction without a variable in common, of which the second lasts; None where there are none."""
    sides = unrelated(operand)
    if len(sides) != 2:
        return None
    first, second = sides
    return (first, second) if is_lasting(second) else (second, first) if is_lasting(first) else None
