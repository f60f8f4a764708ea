"""`once (φ and ψ)` of parts without a variable in common, of which ψ holds for ever once it does.

It holds for values of both where φ last held when ψ already did. So what is kept is one order of steps for each part,
and not the pairs, of which there are as many as combinations.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from itertools import chain, takewhile
from typing import Any

from oracle_server.engines.native.body import NOTHING, Body
from oracle_server.engines.native.held import Held
from oracle_server.engines.native.keys import ALL, Key, Region, key_of, read_key, texts_of
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.standing import Places, Standing, merged
from oracle_server.engines.native.timeline import FEW, Timeline


class Preceded:
    """Knows where φ held last, and where ψ began, in turns; see `Standing`."""

    flat = False
    multiplies = lasting = True

    def __init__(self, last: Body, first: Body, timeline: Timeline) -> None:
        """`last` is φ, `first` ψ: flat, finite, with no variable in common."""
        self._phi, self._psi, self._timeline = Standing(last, timeline), first, timeline
        self.variables = tuple(sorted((*last.variables, *first.variables)))
        self.binds = frozenset(self.variables)
        self._of_phi, self._of_psi = Places(last.variables, self.variables), Places(first.variables, self.variables)
        self.changes: list[Key] = []
        self.began_variables = first.variables
        self.began = Held(len(first.variables), timeline)
        """Where ψ holds, and since which turn, in that order."""
        self.new: list[Key] = []
        """Where it began with this step."""
        self._turn = 0

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        if self.new:
            self.new = []
        began, at = self.began.times, self._psi.at[0]
        new = [key for key in dict.fromkeys(self._psi.touched(NOTHING)) if key not in began and at(key)]
        turning = self._phi.turning()
        if new or turning:
            if self._timeline.journal is not None:
                self._timeline.journal.append(partial(setattr, self, "_turn", self._turn))
            self._turn += 1
            self._take(new, turning)

    def _take(self, new: list[Key], turning: list[Key]) -> None:
        """Take in where ψ began, and where φ turned."""
        for psi in new:
            self.began.add(psi, self._turn)
        self.new = new
        for phi in turning:
            if phi not in self._phi.holds:
                self.changes.append(self._of_phi.whole(phi))
            self._phi.turn(phi, self._turn)
        if len(new) * len(self._phi.holds) > FEW:
            self._timeline.spend(len(new) * len(self._phi.holds))
        for psi in map(self._of_psi.whole, new):
            self.changes += [merged(psi, self._of_phi.whole(phi)) for phi in self._phi.holds]

    def at(self, key: Key) -> bool:
        """The value at a key."""
        since, last = self.began.times.get(self._of_psi.of(key)), self.last(self._of_phi.of(key))
        return since is not None and last is not None and last >= since

    def last(self, phi: Key) -> int | None:
        """The last turn at which φ held at a key, None for never."""
        return self._phi.turn_of(phi, self._turn)

    def when(self, key: Key) -> int | None:
        """The time of a step that makes it hold at a key; None where it does not."""
        return self._phi.time_of(self._of_phi.of(key)) if self.at(key) else None

    def due(self) -> int | None:
        """Never by itself."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """Where ψ holds: it is not flat, and there is no list of its keys."""
        return self.began.times

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place at which it can hold in a region."""
        psi = self._of_psi.region(region)
        if place in self._of_psi.places:
            return self._began_in(region, psi, self._of_psi.places.index(place))
        if ALL not in psi and key_of(psi) not in self.began.times:
            return ()
        return self._phi.spread(self._of_phi.region(region), self._of_phi.places.index(place))

    def _began_in(self, region: Region, psi: Region, place: int) -> Collection[str]:
        """The texts at a place of ψ's keys in a region that had begun when φ last held there."""
        phi, times = self._of_phi.region(region), self.began.times
        if ALL in phi:
            return self.began.spread(psi, place)
        last = self.last(key_of(phi))
        if last is None:
            return ()
        if all(text is ALL or i == place for i, text in enumerate(psi)):
            found: Collection[Key] = list(takewhile(lambda key: times[key] <= last, times))
        else:
            within = [ALL if i == place else text for i, text in enumerate(psi)]
            found = [key for key in self.began.within(within) if times[key] <= last]
        if len(found) > FEW:
            self._timeline.spend(len(found))
        return {text for key in found if (text := texts_of(key)[place]) is not None}

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        return None if self.began.times and self._phi.last else False

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [list(self.began.times.items()), self._phi.snapshot(), self._turn]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        began, phi, self._turn = data
        for key, turn in began:
            self.began.add(read_key(key), turn)
        self._phi.restore(phi)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which one of its parts held, and those that are distinguished below."""
        began = texts_at(self.began.times, self.began_variables, variable)
        return chain(began, self._phi.apart(variable), self._psi.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """True once it holds; false where one of its parts never will again."""
        if self.at(key):
            return True
        phi, psi = self._phi.body.settled[0](self._of_phi.of(key)), self._psi.settled[0](self._of_psi.of(key))
        return False if False in (phi, psi) else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        sides = self._phi.body.can_settle[0](fresh), self._psi.can_settle[0](fresh)
        return fresh.isdisjoint(self.variables), sides[0][1] or sides[1][1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self.began.index()
