"""Relations between variables that never hold, or always do: the values that these can have do not compare so."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import combinations

from oracle_server.core.formula.misatom import TURNED
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import (
    And,
    Atom,
    Constraint,
    Exists,
    Forall,
    Formula,
    Ref,
    Relation,
    children,
    walk,
)
from oracle_server.core.hazards.joins import Use, possible
from oracle_server.core.hazards.misfits import Doubt, described, range_at
from oracle_server.core.hazards.places import Place
from oracle_server.core.ranges import NUMBER, Range

_WAYS: Mapping[str, frozenset[str]] = {
    "<": frozenset("<"), "<=": frozenset("<="), "==": frozenset("="), "!=": frozenset("<>!"), ">": frozenset(">"),
    ">=": frozenset(">="),
}  # fmt: skip
"""How two values can be where they compare so: `!` is for those that have no order, and differ."""
_MOST = 50
"""Relations of one conjunction that are held against each other."""


def unrelated(formula: Formula, places: Sequence[Place]) -> Iterator[Doubt]:
    """The relations that hold for none of the values that events can bind their variables to, or for all.

    Also two that are joined by `and`, and hold together for none.
    """
    told: set[int] = set()
    for relation, uses in _relations(formula):
        ranges = {name: found for name in relation.variables if (found := _range(uses[name], places)) is not None}
        if len(ranges) < len(relation.variables):
            continue
        never = _never(relation, ranges)
        if never:
            told.add(id(relation))
            yield Doubt("unrelated", relation, f"`{render(relation)}` never holds: {never}", relation.at)
        elif _always(relation, ranges):
            always = " and ".join(f"`*{name}` is always {described(found)}" for name, found in ranges.items())
            yield Doubt("related", relation, f"`{render(relation)}` always holds: {always}", relation.at)
    yield from _contradictions(formula, places, told)


def _contradictions(formula: Formula, places: Sequence[Place], told: Set[int]) -> Iterator[Doubt]:
    """Pairs of relations between the same, joined by `and`, of which each may hold, and not both."""
    scopes = {id(relation): uses for relation, uses in _relations(formula)}
    for found in _conjunctions(formula):
        relations = [relation for relation in found if id(relation) not in told]
        for one, other in combinations(relations[:_MOST], 2):
            uses = scopes[id(one)]
            if {*one.variables} == {*other.variables} and not _hold_together(one, other, uses, places):
                told = {*told, id(one), id(other)}
                both = And(one, other)
                text = f"`{render(one)}` and `{render(other)}` never hold together"
                yield Doubt("unrelated", both, text, other.at)


def _conjunctions(formula: Formula) -> Iterator[list[Relation]]:
    """The relations that are joined by `and`, those of each whole conjunction together."""
    inner = set[int]()
    for part in walk(formula):  # the whole comes before its parts
        if isinstance(part, And) and id(part) not in inner:
            stack, found = [part.right, part.left], list[Relation]()
            while stack:
                node = stack.pop()
                if isinstance(node, And):
                    inner.add(id(node))
                    stack += [node.right, node.left]
                elif isinstance(node, Relation):
                    found.append(node)
            yield found


def _hold_together(one: Relation, other: Relation, uses: Mapping[str, Sequence[Use]], places: Sequence[Place]) -> bool:
    """Whether both may hold for the same values."""
    (name, *rest) = one.variables
    if rest:
        op = other.op if one.left == other.left else TURNED.get(other.op, other.op)
        return not _WAYS[one.op].isdisjoint(_WAYS[op])
    found = _range(uses[name], places)
    limits = [Constraint(name, relation.op, relation.right) for relation in (one, other)]
    return found is None or found.meets(limits)


def _relations(formula: Formula) -> list[tuple[Relation, Mapping[str, list[Use]]]]:
    """All relations, each with the constraints that bind the variables there."""
    found: list[tuple[Relation, Mapping[str, list[Use]]]] = []
    waiting: list[tuple[Formula, Mapping[str, list[Use]]]] = [(formula, {})]
    while waiting:
        node, scope = waiting.pop()
        if isinstance(node, Exists | Forall):
            scope = {**scope, node.variable: []}
        elif isinstance(node, Relation):
            found.append((node, scope))
        elif isinstance(node, Atom):
            for constraint in node.constraints:
                if isinstance(constraint.value, Ref):
                    scope[constraint.value.name].append((node, constraint))
        waiting += [(child, scope) for child in reversed(children(node))]
    return found


def _range(uses: Sequence[Use], places: Sequence[Place]) -> Range | None:
    """The values that a variable can be bound to; None where nothing can bind it."""
    found = [range_at(use.key, where) for atom, use in uses if (where := possible(atom, places))]
    if not found:
        return None
    whole = found[0]
    for more in found[1:]:
        whole |= more
    return whole


def _never(relation: Relation, ranges: Mapping[str, Range]) -> str:
    """Why it holds for no values, empty where it may."""
    op, right = relation.op, relation.right
    told = {name: f"`*{name}` is always {described(found)}" for name, found in ranges.items()}
    if op not in ("==", "!="):
        orderless = next((name for name, found in ranges.items() if not found.overlaps(NUMBER)), None)
        if orderless is not None:
            return f"only numbers are smaller or larger, and {told[orderless]}"
    if not isinstance(right, Ref):
        (name,) = ranges
        return "" if ranges[name].meets([Constraint(name, op, right)]) else told[name]
    one, other = (ranges[name] for name in relation.variables)
    if (op == "==" and not one.overlaps(other)) or not _can_compare(one, op, other):
        return " and ".join(told.values())
    return ""


def _always(relation: Relation, ranges: Mapping[str, Range]) -> bool:
    """Whether it holds for all values, though it says more than that there are some."""
    op, right = relation.op, relation.right
    if op == "==":
        return False
    if not isinstance(right, Ref):
        (name,) = ranges
        return ranges[name].always_meets(Constraint(name, op, right))
    one, other = (ranges[name] for name in relation.variables)
    return op == "!=" and not one.overlaps(other)


def _can_compare(one: Range, op: str, other: Range) -> bool:
    """Whether some number of one range compares so with one of another, as far as both are whole numbers."""
    if one.whole is None or other.whole is None or one.kinds or other.kinds or one.values or other.values:
        return True
    (least, most), (lowest, highest) = one.whole, other.whole
    found = {"<": least < highest, "<=": least <= highest, ">": most > lowest, ">=": most >= lowest}
    return found.get(op, True)
