"""Quantifiers that values which no event has had decide, and implications that always hold by their right side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import And, Atom, Exists, Forall, Formula, Implies, Position, atoms, walk
from oracle_server.core.hazards.instants import Instants
from oracle_server.core.hazards.misfits import Doubt, begun_anew
from oracle_server.core.hazards.places import Place


def decided(formula: Formula, known: Instants, places: Sequence[Place]) -> Iterator[Doubt]:
    """The outermost quantifiers that a value which no event has had decides at every event."""
    below: set[int] = set()
    for node in walk(formula):
        if id(node) in below or not isinstance(node, Exists | Forall):
            continue
        holds = isinstance(node, Exists)
        variables, body = _together(node)
        if all(v is holds for v in known.row(node)) and any(v is not holds for v in known.row(body)):
            below |= {id(part) for part in walk(node)}
            where = tuple(p.name for p in places)
            yield Doubt("true" if holds else "false", node, _told(node, variables, body), node.at, where)


def followed(instant: Formula, blamed: Atom, known: Instants, places: Sequence[Place], time: Time) -> Doubt | None:
    """The implication with an atom on its left that always holds, since its right side does wherever its left may."""
    for node in walk(instant):
        if not isinstance(node, Implies) or all(part is not blamed for part in walk(node.left)):
            continue
        sides = list(zip(known.row(node.left), known.row(node.right), strict=True))
        if all(left is False or right is True for left, right in sides) and any(left is not False for left, _ in sides):
            asked = [place for place, (left, _) in zip(places, sides, strict=True) if left is not False]
            message = (
                f"`{render(node.right, time)}` holds wherever `{render(node.left, time)}` does, so that the "
                "implication is always true"
                f"{begun_anew((c.key for atom in atoms(node.right) for c in atom.constraints), asked)}"
            )
            return Doubt("true", node, message, _first(node), tuple(p.name for p in places))
    return None


def _first(node: Formula) -> Position:
    """Where a part of a formula begins, as far as its nodes have a place."""
    return min(part.at for part in walk(node) if isinstance(part, Atom | Exists | Forall))


def _together(node: Exists | Forall) -> tuple[str, Formula]:
    """The variables of a quantifier and of those of its kind right behind it, and what follows them."""
    variables, body = [node.variable], node.body
    while isinstance(body, type(node)):
        variables.append(body.variable)
        body = body.body
    return ", ".join(variables), body


def _told(node: Exists | Forall, variables: str, body: Formula) -> str:
    if isinstance(node, Exists):
        what, instead, mend = "exists", "forall", ", or `and` for `->`" if isinstance(body, Implies) else ""
        part = "`->`" if isinstance(body, Implies) else "what follows"
    else:
        what, instead, mend = "forall", "exists", ", or `->` for `and`" if isinstance(body, And) else ""
        part = "what follows"
    outcome = "holds" if isinstance(node, Exists) else "fails"
    return (
        f"`{what}[{variables}].` {outcome} at every event, whatever the messages say, since {part} {outcome} for "
        f"values that no event has had; write `{instead}[{variables}].`{mend}"
    )
