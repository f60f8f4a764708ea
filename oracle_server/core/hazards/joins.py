"""Variables that join signals which never have a value in common, as a text and a number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from oracle_server.core.formula.tree import Atom, Constraint, Exists, Forall, Formula, Ref, children
from oracle_server.core.hazards.misfits import Doubt, constraint_text, described, range_at
from oracle_server.core.hazards.places import Place, likened, names_of
from oracle_server.core.ranges import Range

Use = tuple[Atom, Constraint]
"""An atom, and its constraint that binds a variable."""


def unjoined(formula: Formula, places: Sequence[Place]) -> Iterator[Doubt]:
    """The uses of each variable at which it has no value that it could have at any other use."""
    for uses in _uses(formula):
        if len({use.key for _, use in uses}) < 2:
            continue
        found = [(atom, use, where) for atom, use in uses if (where := possible(atom, places))]
        ranges = [range_at(use.key, where) for _, use, where in found]
        for i, (atom, use, where) in enumerate(found):
            others = [j for j in range(len(found)) if j != i]
            if others and not any(ranges[i].overlaps(ranges[j]) for j in others):
                other = found[others[0]]
                message = (
                    f"`{constraint_text(use)}` never has a value of `{constraint_text(other[1])}`: "
                    f"`{use.key}` of {names_of(where)} is always {described(ranges[i])}, and `{other[1].key}` of "
                    f"{names_of(other[2])} {described(ranges[others[0]])}{_mend(ranges[i], ranges[others[0]])}"
                )
                yield Doubt("apart", atom, message, atom.at)
                if len(found) == 2:  # each is apart from the other
                    break


def _uses(formula: Formula) -> list[list[Use]]:
    """The constraints that use each variable, quantifier by quantifier."""
    found: list[list[Use]] = []
    waiting: list[tuple[Formula, Mapping[str, list[Use]]]] = [(formula, {})]
    while waiting:
        node, scope = waiting.pop()
        if isinstance(node, Exists | Forall):
            scope = {**scope, node.variable: []}
            found.append(scope[node.variable])
        elif isinstance(node, Atom):
            for constraint in node.constraints:
                if isinstance(constraint.value, Ref):
                    scope[constraint.value.name].append((node, constraint))
        waiting += [(child, scope) for child in reversed(children(node))]
    return found


def possible(atom: Atom, places: Sequence[Place]) -> list[Place]:
    """Where an atom can hold."""
    like = likened(atom, places)
    possible = {id(place) for place in {id(p): p for p in like}.values() if place.value(atom) is not False}
    return [place for place, first in zip(places, like, strict=True) if id(first) in possible]


def _mend(one: Range, other: Range) -> str:
    texts = [found.kinds == {"text"} for found in (one, other)]
    numbers = [found.whole is not None or "number" in found.kinds for found in (one, other)]
    if (texts[0] and numbers[1]) or (texts[1] and numbers[0]):
        return "; declare the number as a text under `signals`, by `string(…)`"
    return ""
