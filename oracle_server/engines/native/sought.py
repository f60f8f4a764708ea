"""`exists` whose values for all combinations would be too many to keep: what it is, is found out where it is asked.

It stands beside what binds its free variables, as in `forall[t, u]. once {a: *t} and once {b: *u} -> exists[l]. …`, so
that it is asked for the combinations alone that the other parts hold for.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.common import Common
from oracle_server.engines.native.expressions import Expression, conjuncts, nodes_of, variables_of
from oracle_server.engines.native.keys import ALL, Key, Region, Variables, fresh_key, key_of, texts_of
from oracle_server.engines.native.related import RelationNode
from oracle_server.engines.native.some import settled_over
from oracle_server.engines.native.timeline import Timeline


class SomeSought:
    """A quantifier whose body has free variables; it keeps nothing."""

    flat = False
    binds: frozenset[int] = frozenset()

    def __init__(self, operand: Expression, bound: int, timeline: Timeline) -> None:
        """`bound` is how many of the operand's variables it binds, which are the last ones."""
        body = self._body = Body(timeline, operand)
        self._timeline = timeline
        self._operand, self._constant = body.at[0], body.constant[0]
        self._own = len(body.variables) - bound
        self._all = (ALL,) * bound
        self.variables: Variables = body.variables[: self._own]
        self.multiplies, self.lasting = body.multiplies, body.lasting
        self.changes: list[Key] = []
        self._common = _common(operand, self.variables, bound, timeline)
        self._able: dict[frozenset[int], tuple[bool, bool]] = {}
        """What it can settle on where these variables have fresh values: there are many keys to look at for that."""

    def at(self, key: Key) -> bool:
        """The value at a key of the free variables."""
        if self._common is not None:
            return self._common.at(key)
        return any(True for _ in self._found([*texts_of(key), *self._all]))

    def among(self, region: Region, place: int, texts: Collection[str]) -> set[str]:
        """Of texts at the only place that a region leaves open, those at which it holds."""
        if self._common is not None:
            return self._common.among(region, place, texts)
        return {text for text in texts if self.at(key_of([*region[:place], text, *region[place + 1 :]]))}

    def step(self) -> None:
        """Tell where the body may have changed."""
        if self._common is not None:
            self._common.step()
        if self._timeline.first:
            self.changes = [fresh_key(self._own)]
            return
        regions = {region[: self._own] for region in self._body.narrowed()}
        self.changes = [key_of([None if text is ALL else text for text in region]) for region in regions]

    def due(self) -> int | None:
        """Never by itself."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """None that are kept."""
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that the body distinguishes at a place of a region."""
        return self._body.spread([*region, *self._all], place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        return self.at(key_of(region)) if ALL not in region else self._constant([*region, *self._all])

    def keys(self, key: Key) -> Collection[Key]:
        """The keys of the body's variables at which it holds, for a key of the free ones."""
        return list(self._found([*texts_of(key), *self._all]))

    @property
    def body_variables(self) -> Variables:
        """The variables of `keys`."""
        return self._body.variables

    def snapshot(self) -> Any:
        """Nothing is kept."""
        return None

    def restore(self, data: Any) -> None:
        """Nothing was kept."""

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished below."""
        return self._body.apart(variable)

    def settled(self, key: Key) -> bool | None:
        """True where the body has settled so at some key of the bound variables, false where it has at all of them."""
        texts = texts_of(key)
        fresh = frozenset(v for v, text in zip(self.variables, texts, strict=True) if text is None)
        able = self._able.get(fresh)
        if able is None:
            able = self._able[fresh] = self.can_settle(fresh)
        if not able[0 if self.at(key) else 1]:
            return None
        return settled_over(self._body, self.keys(key), texts)

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        bound = frozenset(self._body.variables[self._own :])
        return self._body.can_settle[0](fresh)[0], self._body.can_settle[0](fresh | bound)[1]

    def index(self) -> None:
        """Nothing to prepare."""

    def _found(self, region: Sequence[Any]) -> Iterator[Key]:
        """The keys of a region at which the body holds, those with fresh values first."""
        if ALL not in region:
            if self._operand(key := tuple(region)):
                yield key
            return
        if self._constant(region) is False:
            return
        place = region.index(ALL)
        texts = (None, *self._body.spread(region, place))
        self._timeline.spend(len(texts))
        for text in texts:
            yield from self._found([*region[:place], text, *region[place + 1 :]])


def _common(operand: Expression, own: Variables, bound: int, timeline: Timeline) -> Common | None:
    """What finds values that its parts have in common, where there are parts, none of which has all the variables."""
    parts = conjuncts(operand)
    divided = bound == 1 and all(len(variables_of(part)) <= len(own) for part in parts)
    if not divided or any(isinstance(node, RelationNode) for node in nodes_of(operand)):
        return None
    return Common(parts, own, timeline)
