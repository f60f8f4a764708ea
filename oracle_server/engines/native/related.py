"""Relations between variables: they choose among the values that other nodes have bound, and keep nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator

from oracle_server.core.atoms import canonical, precedes
from oracle_server.core.formula.tree import Ref, Relation
from oracle_server.engines.native.compared import value_of
from oracle_server.engines.native.keys import Key, Region, Variables, texts_of


class RelationNode:
    """A relation. Of values that are not told apart it says nothing: something else decides there."""

    flat, multiplies, lasting = True, False, False
    binds: frozenset[int] = frozenset()

    def __init__(self, relation: Relation, number: Callable[[str], int]) -> None:
        """`number` is that of the quantifier that binds a variable."""
        self.variables: Variables = tuple(sorted({number(name) for name in relation.variables}))
        self.changes: list[Key] = []
        self._op = relation.op
        places = {name: self.variables.index(number(name)) for name in relation.variables}
        sides = (relation.left, relation.right)
        self._places = [places[side.name] if isinstance(side, Ref) else None for side in sides]
        self._texts = [None if isinstance(side, Ref) else canonical(side) for side in sides]

    def at(self, key: Key) -> bool:
        """Whether it holds at a key; not where that is not known."""
        return self.settled(key) is True

    def settled(self, key: Key) -> bool | None:
        """Whether it holds at a key, None where that has a value that is not told apart."""
        return self.constant(texts_of(key))

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        left, right = (
            text if place is None else region[place] for place, text in zip(self._places, self._texts, strict=True)
        )
        if not isinstance(left, str) or not isinstance(right, str):
            return None
        if self._op in ("==", "!="):
            return (left == right) is (self._op == "==")
        return precedes(value_of(left), self._op, value_of(right))

    def points(self) -> Collection[Key]:
        """None that could be listed."""
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:  # noqa: ARG002 -- as at every node
        """None that could be listed."""
        return ()

    def index(self) -> None:
        """Nothing to prepare."""

    def apart(self, variable: int) -> Iterator[str]:  # noqa: ARG002
        """None that could be listed."""
        return iter(())

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Both, where its variables have no fresh values: it never changes."""
        told = fresh.isdisjoint(self.variables)
        return told, told
