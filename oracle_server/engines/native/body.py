"""The Boolean part between nodes, as the node above it sees it: values on demand, and the keys at which they change."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from itertools import chain, product
from math import prod
from typing import Any, Protocol

from oracle_server.engines.native.expressions import Expression, bound, is_lasting, nodes_of, variables_of
from oracle_server.engines.native.keys import ALL, Key, Region, Text, Variables, fresh_key, key_of, picker
from oracle_server.engines.native.narrowing import Narrowing, region_of
from oracle_server.engines.native.nodes import Node
from oracle_server.engines.native.related import RelationNode
from oracle_server.engines.native.timeline import FEW, Timeline

_MOST_APART = 256
"""Keys that are looked at, at each step, to find out that a quantifier has settled."""
_LIGHT = 8
"""Operands of a body that cost no more to look at than a key by itself."""


class _Part(Protocol):
    """An expression over the variables of a body."""

    at: Callable[[Key], bool]

    def fresh(self) -> bool | None: ...
    def points(self) -> Collection[Key]: ...
    def spread(self, region: Region, place: int) -> Collection[str]: ...
    def constant(self, region: Region) -> bool | None: ...
    def weight(self) -> int: ...
    def settled(self, key: Key) -> bool | None: ...
    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]: ...


class _Leaf:
    """A node or its negation."""

    __slots__ = ("_fresh", "_key", "_node", "_places", "_positive", "at")

    def __init__(self, node: Node, variables: Variables, *, positive: bool) -> None:
        self._node, self._positive = node, positive
        self._places = [variables.index(v) for v in node.variables]
        self._key = picker(self._places, len(variables))
        self._fresh = fresh_key(len(variables))
        self.at = _value(node.at, self._key, positive)

    def fresh(self) -> bool | None:
        return self.at(self._fresh)

    def points(self) -> Collection[Key]:
        return self._node.points() if self._key is None and self._places else ()

    def spread(self, region: Region, place: int) -> Collection[str]:
        if place not in self._places:
            return ()
        return self._node.spread([region[p] for p in self._places], self._places.index(place))

    def constant(self, region: Region) -> bool | None:
        part = [region[p] for p in self._places]
        value = self._node.constant(part) if ALL in part else self._node.at(key_of(part))
        return value if value is None else value is self._positive

    def weight(self) -> int:
        return len(self._node.points())

    def settled(self, key: Key) -> bool | None:
        value = self._node.settled(key if self._key is None else self._key(key))
        return value if value is None else value is self._positive

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        yes, no = self._node.can_settle(fresh)
        return (yes, no) if self._positive else (no, yes)


class _Related(_Leaf):
    """A relation or its negation: of fresh values it tells nothing."""

    __slots__ = ()

    def fresh(self) -> bool | None:
        return None

    def constant(self, region: Region) -> bool | None:
        value = self._node.constant([region[p] for p in self._places])
        return value if value is None else value is self._positive


def _value(at: Callable[[Key], bool], pick: Callable[[Key], Key] | None, positive: bool) -> Callable[[Key], bool]:
    if pick is None:
        return at if positive else lambda key: not at(key)
    if positive:
        return lambda key: at(pick(key))
    return lambda key: not at(pick(key))


class _Both:
    """A conjunction or, with `absorbing` true, a disjunction: one side that is absorbing decides."""

    __slots__ = ("_absorbing", "_left", "_right", "at")

    def __init__(self, left: _Part, right: _Part, *, absorbing: bool) -> None:
        self._left, self._right, self._absorbing = left, right, absorbing
        p, q = left.at, right.at
        self.at: Callable[[Key], bool] = (lambda k: p(k) or q(k)) if absorbing else (lambda k: p(k) and q(k))

    def fresh(self) -> bool | None:
        """The value at the fresh key, None where a relation may decide it."""
        left = self._left.fresh()
        if left is self._absorbing:
            return left
        right = self._right.fresh()
        return right if left is not None or right is self._absorbing else None

    def points(self) -> Collection[Key]:
        sides = self._deciding(self._left.fresh(), self._right.fresh())
        return set(chain.from_iterable(side.points() for side in sides)) if len(sides) > 1 else sides[0].points()

    def spread(self, region: Region, place: int) -> Collection[str]:
        elsewhere = [*region]
        elsewhere[place] = None
        sides = self._deciding(self._left.constant(elsewhere), self._right.constant(elsewhere))
        if len(sides) == 1:
            return sides[0].spread(region, place)
        return set(chain.from_iterable(side.spread(region, place) for side in sides))

    def constant(self, region: Region) -> bool | None:
        left = self._left.constant(region)
        if left is self._absorbing:
            return left
        right = self._right.constant(region)
        if right is self._absorbing:
            return right
        return None if left is None or right is None else left

    def weight(self) -> int:
        return self._left.weight() + self._right.weight()

    def settled(self, key: Key) -> bool | None:
        left = self._left.settled(key)
        if left is self._absorbing:
            return left
        right = self._right.settled(key)
        if right is self._absorbing:
            return right
        return None if left is None or right is None else left

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        sides = [self._left.can_settle(fresh), self._right.can_settle(fresh)]
        yes, no = [side[0] for side in sides], [side[1] for side in sides]
        return (any(yes), all(no)) if self._absorbing else (all(yes), any(no))

    def _deciding(self, left: bool | None, right: bool | None) -> Sequence[_Part]:
        """Outside of where these sides differ from their values for fresh values, the whole does not either."""
        sides = [s for s, value in ((self._left, left), (self._right, right)) if value is self._absorbing]
        if not sides:
            return (self._left, self._right)
        return (min(sides, key=lambda side: side.weight()),) if len(sides) > 1 else sides


def _part(expression: Expression, variables: Variables) -> _Part:
    positive = not isinstance(expression, tuple)
    if positive or expression[0] == "not":
        node = expression if positive else expression[1]
        return (_Related if isinstance(node, RelationNode) else _Leaf)(node, variables, positive=positive)
    left, right = (_part(e, variables) for e in expression[1:])
    return _Both(left, right, absorbing=expression[0] == "or")


class Own(Protocol):
    """The keys that the node above a body distinguishes itself."""

    def points(self) -> Collection[Key]:
        """All of them."""
        ...

    def spread(self, region: Region, place: int) -> Collection[str]:
        """Their texts at a place of a region."""
        ...


class _Nothing:
    def points(self) -> Collection[Key]:
        return ()

    def spread(self, region: Region, place: int) -> Collection[str]:  # noqa: ARG002
        return ()


NOTHING: Own = _Nothing()


def weight(operands: int) -> int:
    """What it takes to look at a key, where so many operands are asked for their value there."""
    return 1 + operands // _LIGHT


class Body:
    """One expression or more under a node, over the variables of all of them."""

    __slots__ = (
        "_cost",
        "_fresh",
        "_leaves",
        "_narrowing",
        "_parts",
        "_timeline",
        "_weight",
        "at",
        "binds",
        "can_settle",
        "constant",
        "flat",
        "lasting",
        "multiplies",
        "nodes",
        "operands",
        "settled",
        "variables",
    )

    def __init__(self, timeline: Timeline, *expressions: Expression) -> None:
        self.variables = variables_of(*expressions)
        self._parts = [_part(e, self.variables) for e in expressions]
        self.at = [part.at for part in self._parts]
        """The value of each expression at a key."""
        self.settled = [part.settled for part in self._parts]
        """Its value at a key, where no continuation can change it."""
        self.can_settle = [part.can_settle for part in self._parts]
        self.constant = [part.constant for part in self._parts]
        """Its value in all of a region, None where it may differ."""
        self.binds = bound(expressions[0])
        """Of the variables, those that have one of finitely many values, none fresh, where the first one holds."""
        self.lasting = is_lasting(expressions[0])
        """Whether the first expression holds from then on at a key where it once does."""
        found = dict.fromkeys(node for e in expressions for node in nodes_of(e))
        self.nodes = [node for node in found if not isinstance(node, RelationNode)]
        """Those that change."""
        self.multiplies = any(node.multiplies for node in self.nodes)
        """Whether some node below multiplies; see `Node`."""
        size = len(self.variables)
        self.flat = size < 2 or all(n.flat and n.variables == self.variables for n in self.nodes)
        """Whether the values differ from those at the fresh key at finitely many keys without fresh values."""
        self._leaves = [(n, [self.variables.index(v) for v in n.variables]) for n in self.nodes]
        self._narrowing = Narrowing(expressions[0], self.variables) if len(expressions) == 1 else None
        self._fresh = fresh_key(size)
        self._timeline = timeline
        self._cost = 1 + len(self._leaves) ** 2 // 16
        """What it takes to look at a region: each operator looks at all below it, and so does each below."""
        self.operands = sum(len(nodes_of(e)) for e in expressions)
        self._weight = weight(self.operands)
        """What it takes to look at a key: each operand is asked for its value there."""
        if not self.flat:
            for node in self.nodes:
                node.index()

    def touched(self, own: Own) -> Collection[Key]:
        """The keys at which a value may have changed with this step, those with fresh values last.

        At the first step, and where all values may have changed, these are the keys that are distinguished here,
        those of `own`, and the fresh one.
        """
        if self._timeline.first:
            return self._everything(own)
        if not self.flat:
            return self._mixed(own)
        keys: list[Key] | None = None
        for node, places in self._leaves:
            changes = node.changes
            if changes:
                if len(places) < len(self.variables) or self._fresh in changes:
                    return self._everything(own)
                keys = changes if keys is None else keys + changes
        return keys or ()

    def apart(self, variable: int) -> Iterator[str]:
        """The texts of a variable that may, now or later, have other values than its fresh one; some repeatedly."""
        return chain.from_iterable(node.apart(variable) for node in self.nodes)

    def look_at(self, keys: int) -> None:
        """Count keys that the node above looks at. Raises `EngineError` where they cost too much."""
        if keys > FEW:
            self._timeline.spend(keys * self._weight)

    def all_settled(self, value: bool, *, some: bool, own: Sequence[Text] = ()) -> bool:
        """Whether the first expression has settled on a value at all keys that begin with these texts, or at `some`.

        False too where there are too many keys to look at.
        """
        settled, choices, seen = self.settled[0], [{text} for text in own], 0
        for variable in self.variables[len(own) :]:
            texts: set[Text] = {None}
            for text in self.apart(variable):
                seen += 1
                if seen > _MOST_APART:
                    return False
                texts.add(text)
            choices.append(texts)
        if prod(map(len, choices)) > _MOST_APART:
            return False
        found = (settled(key_of(texts)) is value for texts in product(*choices))
        return any(found) if some else all(found)

    def _everything(self, own: Own) -> Collection[Key]:
        if not self.flat:
            return self._resolve([[ALL] * len(self.variables)], own)
        keys = set(own.points()).union(*(part.points() for part in self._parts))
        if len(keys) > FEW:
            self._timeline.spend(len(keys) * self._weight)
        keys.discard(self._fresh)
        return [*keys, self._fresh]

    def regions(self) -> set[Key]:
        """The regions in which a value may have changed with this step."""
        return {region_of(key, node.variables, self.variables) for node in self.nodes for key in node.changes}

    def narrowed(self) -> Collection[Key]:
        """The same, without those parts of them in which an atom tells that nothing can have changed."""
        regions = self.regions()
        return regions if self._narrowing is None else self._narrowing.of(regions)

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that distinguish values at a place of a region, where all before that place is no `ALL`."""
        return set(chain.from_iterable(part.spread(region, place) for part in self._parts))

    def _mixed(self, own: Own) -> Collection[Key]:
        regions = self.narrowed()
        return self._resolve(regions, own) if regions else ()

    def _resolve(self, regions: Collection[Region], own: Own) -> Collection[Key]:
        found: _Found = {}
        keys: list[Key] = []
        known = -1
        while known < len(keys):  # what one region distinguishes is distinguished in the others too
            known = len(keys)
            for region in regions:
                self._split(list(region), own, found, keys)
            if len(regions) == 1:
                break
        return sorted(keys, key=lambda key: [text is None for text in key])

    def _split(self, region: list[Any], own: Own, found: _Found, keys: list[Key]) -> None:
        """Add the keys of a region between which values may differ, here, in `own` or by the keys found so far."""
        if ALL not in region:
            if _add(found, region):
                keys.append(tuple(region))
            return
        place = region.index(ALL)
        below = _below(found, region[:place])
        texts: set[str | None] = {None, *own.spread(region, place)}.union(*below)
        for part in self._parts:
            texts.update(part.spread(region, place))
        self._timeline.spend(self._cost + len(texts) + len(below))
        for text in texts:
            inner = region.copy()
            inner[place] = text
            self._split(inner, own, found, keys)


_Found = dict[str | None, Any]
"""Keys as a tree: by the first text, then the second one, and so on."""


def _add(found: _Found, key: Sequence[str | None]) -> bool:
    """Add a key; whether it is new."""
    *path, last = key
    for text in path:
        found = found.setdefault(text, {})
    if last in found:
        return False
    found[last] = {}
    return True


def _below(found: _Found, path: Sequence[str | None]) -> list[_Found]:
    """The branches that a path leads to, where a fresh value on the way stands for any."""
    branches = [found]
    for text in path:
        ways = (None,) if text is None else (None, text)
        branches = [branch[way] for branch in branches for way in ways if way in branch]
    return branches
