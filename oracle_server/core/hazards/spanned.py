"""Atoms joined by `or` of which one holds whatever the value is, as of two that leave out a value each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations

from oracle_server.core.atoms import meets
from oracle_server.core.formula.render import render_atom
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Or, children
from oracle_server.core.hazards.joins import possible
from oracle_server.core.hazards.misfits import Doubt, range_at
from oracle_server.core.hazards.places import Place
from oracle_server.core.kinds import NAMING

_MOST = 20
"""Most atoms of one `or` that are looked at two by two."""


def spanned(formula: Formula, places: Sequence[Place]) -> Iterator[Doubt]:
    """Two atoms of each `or` one of which every value of their signal meets, though neither is met by all.

    `{b} or {b: false}` may well ask whether there is a value, so that equalities are left alone.
    """
    for parts in _alternatives(formula):
        told = next((pair for pair in combinations(parts[:_MOST], 2) if _spans(*pair, places)), None)
        if told is not None:
            one, other = told
            mend = f"write `{render_atom(one)} and {render_atom(other)}` where both are asked"
            message = (
                f"`{render_atom(one)} or {render_atom(other)}` holds for every value of `{_own(one).key}`, since one "
                f"of both always does; {mend}"
            )
            yield Doubt("spanned", Or(one, other), message, one.at)


def _alternatives(formula: Formula) -> Iterator[list[Atom]]:
    """The atoms of each `or` that ask for other values than one of a single signal."""
    waiting: list[tuple[Formula, bool]] = [(formula, False)]
    while waiting:
        node, joined = waiting.pop()
        if isinstance(node, Or) and not joined:
            yield [atom for atom in _flat(node) if _is_plain(atom)]
        waiting += [(child, isinstance(node, Or)) for child in reversed(children(node))]


def _flat(node: Formula) -> Iterator[Atom]:
    if isinstance(node, Or):
        yield from _flat(node.left)
        yield from _flat(node.right)
    elif isinstance(node, Atom):
        yield node


def _is_plain(atom: Atom) -> bool:
    asked = [c for c in atom.constraints if c.key not in NAMING]
    return len(asked) == 1 and asked[0].op != "==" and isinstance(asked[0].value, str | bool | int | float)


def _own(atom: Atom) -> Constraint:
    return next(c for c in atom.constraints if c.key not in NAMING)


def _spans(one: Atom, other: Atom, places: Sequence[Place]) -> bool:
    """Whether each value that the signal can have meets one of two atoms, and not all of them the same."""
    asked = [_own(one), _own(other)]
    names = [{(c.key, c.op, c.value) for c in atom.constraints if c.key in NAMING} for atom in (one, other)]
    if asked[0].key != asked[1].key or names[0] != names[1]:
        return False
    where = possible(one, places)
    found = range_at(asked[0].key, where)
    if not where or any(found.always_meets(c) for c in asked):
        return False
    values = list(found.telling(asked))
    return bool(values) and all(any(meets(c, value) for c in asked) for value in values)
