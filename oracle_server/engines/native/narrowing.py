"""Where an expression can have changed: only where an atom holds, or did, without which it holds nowhere.

So `({read: *t, of: *x} or {write: *t, of: *x}) and not ({free: *l} since {take: *l, by: *t})` is looked at for the `t`
and `x` that are read or written, and not for all that are known when a lock is taken.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from oracle_server.engines.native.expressions import Expression, conjuncts
from oracle_server.engines.native.keys import ALL, Key, Region, Variables, texts_of
from oracle_server.engines.native.nodes import ABSENT, AtomNode


class Narrowing:
    """What makes the regions of an expression smaller."""

    __slots__ = ("_guards", "_variables")

    def __init__(self, expression: Expression, variables: Variables) -> None:
        self._variables = variables
        self._guards = [atoms for part in conjuncts(expression) if (atoms := _atoms(part))]
        """Of each of these atoms, one holds wherever the expression does."""

    def of(self, regions: Collection[Key]) -> Collection[Key]:
        """The parts of regions in which the expression holds, or did before this step."""
        for atoms in self._guards:
            if not regions:
                break
            around = {
                region_of(key, atom.variables, self._variables)
                for atom in atoms
                for key in (*atom.changes, atom.current)
                if key is not ABSENT
            }
            met = (_both(region, other) for region in regions for other in around)
            regions = {region for region in met if region is not None}
        return regions


def region_of(key: Key, own: Variables, variables: Variables) -> Key:
    """The region of these variables that a key of some of them stands for; a fresh value does for all."""
    region: list[Any] = [ALL] * len(variables)
    for variable, text in zip(own, texts_of(key), strict=True):
        if text is not None:
            region[variables.index(variable)] = text
    return tuple(region)


def _atoms(part: Expression) -> list[AtomNode]:
    """The atoms of which a part is the disjunction, none where it is something else."""
    if isinstance(part, AtomNode):
        return [part]
    if not isinstance(part, tuple) or part[0] != "or":
        return []
    left, right = _atoms(part[1]), _atoms(part[2])
    return left + right if left and right else []


def _both(region: Region, other: Region) -> Key | None:
    """What two regions have in common."""
    if any(r != o and r is not ALL and o is not ALL for r, o in zip(region, other, strict=True)):
        return None
    return tuple([o if r is ALL else r for r, o in zip(region, other, strict=True)])
