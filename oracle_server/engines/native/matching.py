"""The keys at which a conjunction holds, or what else binds all its variables: found by joining its parts.

A step looks at the keys that changed below, and from each goes on to the variable for which fewest values are possible,
as the other parts tell by the values that are fixed. So it costs the matches, and not the combinations.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.expressions import Expression, all_of, conjuncts
from oracle_server.engines.native.finding import finder
from oracle_server.engines.native.held import Held
from oracle_server.engines.native.keys import ALL, Key, Region, key_of, read_key, texts_of
from oracle_server.engines.native.nodes import AtomNode
from oracle_server.engines.native.sought import SomeSought
from oracle_server.engines.native.timeline import FEW, Timeline


class Matching:
    """Holds where an expression does that can't hold for fresh values; it stands between the expression and a node."""

    flat = multiplies = True

    def __init__(self, expression: Expression, timeline: Timeline) -> None:
        """`expression` is finite; see `is_finite`."""
        self._timeline = timeline
        parts = sorted(conjuncts(expression), key=lambda part: not isinstance(part, AtomNode))
        body = self._body = Body(timeline, all_of(parts))
        self._operand, self._constant = body.at[0], body.constant[0]
        self.variables, self.lasting = body.variables, body.lasting
        self.binds = frozenset(body.variables)
        self.changes: list[Key] = []
        self._held = Held(len(self.variables), timeline, counted=True)
        self.at = self._held.times.__contains__
        found = [finder(all_of(parts), self.variables, place) for place in range(len(self.variables))]
        self._finders = [each for each in found if each is not None]
        assert len(self._finders) == len(found)  # noqa: S101 -- the expression is finite
        self._sought = [one for part in parts if (one := _sought(part)) is not None]
        """Quantifiers that are asked for many values at once, and whether they must hold."""
        self._guards = [part for part in parts if isinstance(part, AtomNode)]
        """Atoms without which it holds nowhere."""
        self._guarded = [[self.variables.index(v) for v in guard.variables] for guard in self._guards]

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        held = self._held
        if not all(guard.holds for guard in self._guards):
            for key in list(held.times):
                self._drop(key)
            return
        if any(guard.changes for guard in self._guards):
            self._renew(list(held.times), [self._at_guards()])
            return
        regions = [(ALL,) * len(self.variables)] if self._timeline.first else self._body.regions()
        if regions:
            stale = {key for region in regions for key in held.within(region)}
            self._renew(stale, regions)

    def due(self) -> int | None:
        """Never by itself."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """The keys at which it holds."""
        return self._held.times

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        return self._held.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        return self._held.constant(region)

    def snapshot(self) -> Any:
        """The state as plain data."""
        return list(self._held.times)

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        for key in data:
            self._held.add(read_key(key), 0)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished below."""
        return self._body.apart(variable)

    def settled(self, key: Key) -> bool | None:
        """The value at a key, where no continuation can change it; None where one may."""
        return self._body.settled[0](key)

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        return self._body.can_settle[0](fresh)

    def index(self) -> None:
        """Prepare for `spread`."""
        self._held.index()

    def _renew(self, stale: Collection[Key], regions: Collection[Region]) -> None:
        """Let go of keys that do not hold any more, and take in those of regions that do."""
        looked = len(stale) + len(regions)
        if looked > FEW:
            self._timeline.spend(looked)
        for key in stale:
            if not self._operand(key):
                self._drop(key)
        found: list[Key] = []
        for region in regions:
            self._find([*region], found)
        times = self._held.times
        for key in found:
            if key not in times:
                self._held.add(key, 0)
                self.changes.append(key)

    def _find(self, region: list[Any], found: list[Key]) -> None:
        """Add the keys of a region at which the expression holds."""
        if ALL not in region:
            key = key_of(region)
            if self._operand(key):
                found.append(key)
            return
        if self._constant(region) is False:
            return
        place, texts = self._fewest(region)
        if len(texts) > 1:
            self._timeline.spend(len(texts))
            if self._sought and region.count(ALL) == 1:
                texts = self._sifted(region, place, texts)
        for text in texts:
            region[place] = text
            self._find(region, found)
        region[place] = ALL

    def _sifted(self, region: Region, place: int, texts: Collection[str]) -> Collection[str]:
        """Those texts of the last variable at which the quantifiers are as they must be."""
        for node, positive in self._sought:
            own = [i for i, variable in enumerate(self.variables) if variable in node.variables]
            if place in own:
                found = node.among([region[i] for i in own], own.index(place), texts)
                texts = found if positive else set(texts).difference(found)
        return texts

    def _fewest(self, region: Region) -> tuple[int, Collection[str]]:
        """The variable with the fewest candidates, and these."""
        best: tuple[int, Collection[str]] | None = None
        for place, text in enumerate(region):
            if text is ALL:
                texts = self._finders[place](region)
                if best is None or len(texts) < len(best[1]):
                    best = place, texts
                if len(texts) < 2:
                    break
        assert best is not None  # noqa: S101 -- something is left to be found
        return best

    def _at_guards(self) -> Region:
        """The values that the atoms have, those of the last one where two differ: then it holds nowhere."""
        region: list[Any] = [ALL] * len(self.variables)
        for guard, places in zip(self._guards, self._guarded, strict=True):
            for place, text in zip(places, texts_of(guard.current), strict=True):
                region[place] = text
        return region

    def _drop(self, key: Key) -> None:
        self._held.remove(key)
        self.changes.append(key)


def _sought(part: Expression) -> tuple[SomeSought, bool] | None:
    """A quantifier that is sought for, and whether it must hold; None for any other part."""
    positive = not isinstance(part, tuple)
    node = part if positive else part[1]
    return (node, positive) if isinstance(node, SomeSought) and (positive or part[0] == "not") else None
