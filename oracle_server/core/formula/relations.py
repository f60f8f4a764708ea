"""Relations between variables, `*x < *y`: they only choose among values that something beside them has bound."""

from __future__ import annotations

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import excludes, needs, obligation
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Formula, Relation, children, walk

_NONE = frozenset[str]()
_AWAITED = (
    "stands in what is awaited; a signal is compared there with what the trigger has bound, as in `{speed <= *x}`, and "
    "variables with each other before `->`"
)


def check_relations(formula: Formula) -> None:
    """Refuse relations whose variables may have values that nothing binds. Raises `FormulaError` with its place.

    Of what is joined by `and`, `or`, `->` and `not` at one step, a relation matters only where the rest leaves the
    outcome open; its variables must not be able to have there a value that no event has had.
    """
    if not has_relations(formula):
        return
    found = obligation(formula)
    if found is None:
        _check(formula, _NONE)
        return
    for node in walk(found.goal):
        if isinstance(node, Relation):
            raise FormulaError(f"`{render(node)}` {_AWAITED}", *node.at)
    if found.trigger is not None:
        _check(found.trigger, _NONE)


def has_relations(formula: Formula) -> bool:
    """Whether a formula compares the values of variables."""
    return any(isinstance(node, Relation) for node in walk(formula))


def _check(node: Formula, bound: frozenset[str]) -> None:
    """Refuse the relations of a part that matters only where these variables have values that are bound."""
    match node:
        case Relation():
            missing = next((name for name in node.variables if name not in bound), None)
            if missing is not None:
                raise FormulaError(_unbound(node, missing), *node.at)
        case tree.Not(operand):
            _check(operand, bound)
        case tree.And(left, right):
            _check(left, bound | needs(right))
            _check(right, bound | needs(left))
        case tree.Or(left, right):
            _check(left, bound | excludes(right))
            _check(right, bound | excludes(left))
        case tree.Implies(left, right):
            _check(left, bound | excludes(right))
            _check(right, bound | needs(left))
        case _:
            for child in children(node):
                _check(child, _NONE)


def _unbound(node: Relation, name: str) -> str:
    return (
        f"`{render(node)}`: nothing that holds beside it binds '{name}'; write it beside an atom that does, within the "
        f"same quantifier and the same `once`, `since` or `pre`, as `{{value: *{name}}} and {render(node)}` or "
        f"`{{value: *{name}}} -> {render(node)}`"
    )
