"""Relations between variables, `*x < *y`: they only choose among values that something beside them has bound."""

from __future__ import annotations

from collections.abc import Iterator

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
        _check(formula)
        return
    for node in walk(found.goal):
        if isinstance(node, Relation):
            raise FormulaError(f"`{render(node)}` {_AWAITED}", *node.at)
    if found.trigger is not None:
        _check(found.trigger)


def _check(formula: Formula) -> None:
    for node, name, around in _unbound(formula, _NONE, _NONE, _NONE):
        _refuse(node, name, around)


def has_relations(formula: Formula) -> bool:
    """Whether a formula compares the values of variables."""
    return any(isinstance(node, Relation) for node in walk(formula))


def wanted(body: Formula) -> frozenset[str]:
    """The variables of relations in a quantifier's body that something beside the quantifier binds."""
    if not has_relations(body):
        return _NONE
    return frozenset(name for _, name, _ in _unbound(body, _NONE, _NONE, _NONE))


def _unbound(
    node: Formula, bound: frozenset[str], before: frozenset[str], around: frozenset[str]
) -> Iterator[tuple[Relation, str, bool]]:
    """The relations of a part with their variables that are not bound, and whether they are `around` an operator.

    The part matters only where those that are `bound` have values of events; of these, `before` are those that are so
    by what stands to the left of it, which alone counts within quantifiers. Those `around` are bound beside a `once`,
    `since` or the like that the part stands within.
    """
    match node:
        case Relation():
            yield from ((node, name, name in around) for name in node.variables if name not in bound)
        case tree.Not(operand):
            yield from _unbound(operand, bound, before, around)
        case tree.And(left, right) | tree.Implies(left, right) | tree.Or(left, right):
            by_left = excludes(left) if isinstance(node, tree.Or) else needs(left)
            by_right = needs(right) if isinstance(node, tree.And) else excludes(right)
            yield from _unbound(left, bound | by_right, before, around)
            yield from _unbound(right, bound | by_left, before | by_left, around)
        case tree.Exists(variable, body) | tree.Forall(variable, body):
            yield from _unbound(body, before - {variable}, before - {variable}, around - {variable})
        case _:
            for child in children(node):
                yield from _unbound(child, _NONE, _NONE, around | bound)


def _refuse(node: Relation, name: str, around: bool) -> None:
    if around:
        others = [other for other in node.variables if other != name]
        example = f"once {{value: *{others[0]}}}" if others else f"{{value: *{name}}}"
        raise FormulaError(
            f"`{render(node)}`: nothing that holds beside it binds '{name}' within the same `once`, `since` or `pre`, "
            f"but outside of that something does; a relation has no time: write it there, as in "
            f"`{example} and {render(node)}`",
            *node.at,
        )
    raise FormulaError(
        f"`{render(node)}`: nothing that holds beside it binds '{name}'; write it behind an atom that does, within the "
        f"same `once`, `since` or `pre`, as `{{value: *{name}}} and {render(node)}` or "
        f"`{{value: *{name}}} -> {render(node)}`",
        *node.at,
    )
