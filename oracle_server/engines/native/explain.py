"""Why a formula holds or does not at the last step, read off its nodes.

A conjunction that fails is explained by one side that does, one that holds by both, and so on down to atoms and
temporal operators. These are explained by a step, or by where there is none.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

from oracle_server.core.explanation import Reason, Why
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Ref, Scalar
from oracle_server.engines.native.build import Network, Path
from oracle_server.engines.native.ever import Ever
from oracle_server.engines.native.guarded import SomeGuarded
from oracle_server.engines.native.keys import Text, key_of, texts_of
from oracle_server.engines.native.some import Some, SomeOf
from oracle_server.engines.native.window import Window

Values = Mapping[int, Text]
"""What each quantified variable stands for, None for any value that is not told apart."""


def explain(formula: Formula, network: Network, time: Time) -> Why:
    """Why the formula holds, or does not, at the last step."""
    part = _Part(formula, (), {}, {})
    explainer = _Explainer(network, time)
    quantified = isinstance(formula, tree.Exists | tree.Forall)
    holds = explainer.holds(part)
    deciding = explainer.deciding(part) if quantified and holds is isinstance(formula, tree.Exists) else None
    if deciding is None:
        return Why(holds, {}, 0, tuple(explainer.reasons(part)))
    inner, others = deciding
    values = {name: _scalar(inner.values[i]) for name, i in inner.scope.items() if i in inner.values}
    return Why(holds, values, others, tuple(explainer.reasons(inner)))


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of the formula, where it stands, what binds its variables, and what they stand for."""

    formula: Formula
    path: Path
    scope: Mapping[str, int]
    values: Values

    def child(self, formula: Formula, place: int = 0) -> _Part:
        return _Part(formula, (*self.path, place), self.scope, self.values)


class _Explainer:
    def __init__(self, network: Network, time: Time) -> None:
        self._network, self._time = network, time
        self._clock = network.clock

    def holds(self, part: _Part) -> bool:
        """Whether a part holds now."""
        node = self._network.places.get(part.path)
        formula = part.formula
        match formula:
            case tree.Not(operand):
                return not self.holds(part.child(operand))
            case tree.And(left, right):
                return self.holds(part.child(left)) and self.holds(part.child(right, 1))
            case tree.Or(left, right):
                return self.holds(part.child(left)) or self.holds(part.child(right, 1))
            case tree.Implies(left, right):
                return not self.holds(part.child(left)) or self.holds(part.child(right, 1))
        if node is None:  # a quantifier whose variables no node uses
            return self.holds(self._body(part))
        value = node.at(key_of([part.values.get(v) for v in node.variables]))
        return not value if isinstance(formula, tree.Historically | tree.Forall) else value

    def reasons(self, part: _Part) -> list[Reason]:  # noqa: PLR0911 -- a case a node
        """What decides whether a part holds."""
        holds = self.holds(part)
        match part.formula:
            case tree.Not(operand):
                return self.reasons(part.child(operand))
            case tree.And(left, right):
                return self._sides([part.child(left), part.child(right, 1)], [holds, holds], all_of=holds)
            case tree.Or(left, right):
                return self._sides([part.child(left), part.child(right, 1)], [holds, holds], all_of=not holds)
            case tree.Implies(left, right):
                return self._sides([part.child(left), part.child(right, 1)], [not holds, holds], all_of=not holds)
            case tree.Exists() | tree.Forall():
                return [self._quantifier(part, holds)]
            case tree.Atom():
                text = f"{'holds' if holds else 'does not hold'} at {self._shown(self._clock.now)}"
                return [Reason(self._render(part), holds, text, self._clock.now if holds else None)]
            case _:
                return [self._temporal(part, holds)]

    def deciding(self, part: _Part) -> tuple[_Part, int] | None:
        """A quantifier's body with values that decide it, and how many others there are; None where all do together."""
        node = self._network.places.get(part.path)
        if not isinstance(part.formula, tree.Exists | tree.Forall) or not isinstance(node, Some | SomeOf | SomeGuarded):
            return None
        own = key_of([part.values.get(v) for v in node.variables])
        keys = sorted(node.keys(own), key=lambda key: [(text is None, text or "") for text in texts_of(key)])
        if not keys:
            return None
        found = dict(zip(node.body_variables, texts_of(keys[0]), strict=True))
        body = self._body(part)
        return _Part(body.formula, body.path, body.scope, {**part.values, **found}), len(keys) - 1

    def _sides(self, sides: list[_Part], wanted: list[bool], *, all_of: bool) -> list[Reason]:
        """The reasons of the sides that stand as wanted: of all, or of the one with the fewest."""
        found = [self.reasons(s) for s, value in zip(sides, wanted, strict=True) if self.holds(s) is value]
        return [reason for reasons in found for reason in reasons] if all_of else min(found, key=len)

    def _quantifier(self, part: _Part, holds: bool) -> Reason:
        deciding = self.deciding(part) if holds is isinstance(part.formula, tree.Exists) else None
        if deciding is None:
            text = "for every value" if holds else "for no value"
            return Reason(self._render(part), holds, text)
        inner, others = deciding
        given = {name: inner.values[i] for name, i in inner.scope.items() if i in inner.values}
        told = ", ".join(f"{name} = {text or 'any other value'}" for name, text in given.items())
        text = f"for {told}" + (f" (and {others} more)" if others else "")
        return Reason(self._render(part), holds, text, parts=tuple(self.reasons(inner)))

    def _temporal(self, part: _Part, holds: bool) -> Reason:
        formula = part.formula
        if isinstance(formula, tree.Pre):
            before = self._clock.before or None
            where = "there is no step before"
            if before is not None:
                where = f"its operand {'held' if holds else 'did not hold'} at {self._shown(before)}"
            return Reason(self._render(part), holds, where, before)
        assert isinstance(formula, tree.Once | tree.Historically | tree.Since)  # noqa: S101 -- what is left
        node = self._network.places[part.path]
        assert isinstance(node, Ever | Window)  # noqa: S101 -- what these are built as
        at = node.when(key_of([part.values.get(v) for v in node.variables]))
        if at is None:
            return self._nowhere(part, formula, holds)
        now, negated = at == self._clock.now, isinstance(formula, tree.Historically)
        word = ("does not hold" if negated else "holds") if now else ("did not hold" if negated else "held")
        where = f"{'its right side ' if isinstance(formula, tree.Since) else ''}{word} at {self._shown(at)}"
        return Reason(self._render(part), holds, where, at)

    def _nowhere(self, part: _Part, formula: tree.Once | tree.Historically | tree.Since, holds: bool) -> Reason:
        first, last = self._window(formula.bound)
        where = self._shown_window(formula.bound)
        words = {tree.Once: "none", tree.Historically: "at every one"}
        text = f"{words.get(type(formula), 'none with its left side ever since')} {where}"
        return Reason(self._render(part), holds, text, window=(first, last) if first <= last else None)

    def _window(self, bound: Bound) -> tuple[int, int]:
        first = 1 if bound.upper is None else max(1, self._clock.now - bound.upper)
        return first, self._clock.now - bound.lower

    def _shown_window(self, bound: Bound) -> str:
        first, last = self._window(bound)
        if self._time == "steps":
            if last < first:
                return "before there were steps"
            return f"in steps {first}–{last}" if last > first else f"in step {first}"  # noqa: RUF001 -- a range
        near, far = _duration(bound.lower), None if bound.upper is None else _duration(bound.upper)
        if far is None:
            return f"{near} ago or earlier" if bound.lower else "so far"
        return f"between {near} and {far} ago" if bound.lower else f"in the last {far}"

    def _shown(self, time: int) -> str:
        if time == self._clock.now:
            return "this step" if self._time == "seconds" else f"step {time}"
        return f"step {time}" if self._time == "steps" else f"a step {_duration(self._clock.now - time)} ago"

    def _body(self, part: _Part) -> _Part:
        """What a quantifier, and those of its kind that follow, say of their variables."""
        formula, path, kind = part.formula, part.path, type(part.formula)
        while isinstance(formula, tree.Exists | tree.Forall) and type(formula) is kind:
            formula, path = formula.body, (*path, 0)
        return _Part(formula, path, self._network.scopes[part.path], part.values)

    def _render(self, part: _Part) -> str:
        values = {name: part.values[i] for name, i in part.scope.items() if part.values.get(i) is not None}
        return render(_with(part.formula, {name: _scalar(text) for name, text in values.items()}), self._time)


def _with(formula: Formula, values: Mapping[str, Scalar | None]) -> Formula:
    """The formula with values in place of its free variables."""
    match formula:
        case Atom(constraints):
            return Atom(tuple(_given(c, values) for c in constraints))
        case tree.Not(operand) | tree.Pre(operand):
            return type(formula)(_with(operand, values))
        case tree.And(left, right) | tree.Or(left, right) | tree.Implies(left, right):
            return type(formula)(_with(left, values), _with(right, values))
        case tree.Once(operand, bound) | tree.Historically(operand, bound):
            return type(formula)(_with(operand, values), bound)
        case tree.Since(left, right, bound):
            return tree.Since(_with(left, values), _with(right, values), bound)
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            inner = {name: value for name, value in values.items() if name != variable}
            return type(formula)(variable, _with(body, inner))


def _given(constraint: Constraint, values: Mapping[str, Scalar | None]) -> Constraint:
    if not isinstance(constraint.value, Ref):
        return constraint
    value = values.get(constraint.value.name)
    return constraint if value is None else Constraint(constraint.key, "==", value)


def _scalar(text: Text) -> Scalar | None:
    """The value of a canonical text, None for the fresh one."""
    if text is None:
        return None
    value: Scalar = json.loads(text)
    return value


def _duration(nanoseconds: int) -> str:
    for unit, size in (("s", 10**9), ("ms", 10**6), ("us", 10**3)):
        if nanoseconds >= size or nanoseconds % size == 0:
            return f"{nanoseconds / size:.9g}{unit}"
    return f"{nanoseconds}ns"
