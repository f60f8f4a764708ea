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
from oracle_server.engines.native.keys import ALL, Key, Region, Text, key_of, read_key, texts_of
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.timeline import FEW, Timeline


class Preceded:
    """Knows where φ held last, and where ψ began; steps at which one of them turned are counted, as *turns*."""

    flat = False
    slim = multiplies = lasting = True

    def __init__(self, last: Body, first: Body, timeline: Timeline) -> None:
        """`last` is φ, `first` ψ: flat, finite, with no variable in common."""
        self._phi, self._psi, self._timeline = last, first, timeline
        self.variables = tuple(sorted((*last.variables, *first.variables)))
        self._phi_places = [self.variables.index(v) for v in last.variables]
        self._psi_places = [self.variables.index(v) for v in first.variables]
        self.began_variables = first.variables
        self.changes: list[Key] = []
        self.began = Held(len(first.variables), timeline)
        """Where ψ holds, and since which turn, in that order."""
        self.new: list[Key] = []
        """Where it began with this step."""
        self._holds = Held(len(last.variables), timeline)
        """Where φ holds now."""
        self._last: dict[Key, tuple[int, int]] = {}
        """Where it ever held: the last turn at which it did, and the time, unless it holds now."""
        self._turn = 0

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        if self.new:
            self.new = []
        began, holds = self.began.times, self._holds.times
        at = self._psi.at[0]
        new = [key for key in dict.fromkeys(self._psi.touched(NOTHING)) if key not in began and at(key)]
        at = self._phi.at[0]
        turned = [key for key in dict.fromkeys(self._phi.touched(self._holds)) if at(key) is not (key in holds)]
        if new or turned:
            self._note(partial(setattr, self, "_turn", self._turn))
            self._turn += 1
            for key in new:
                self.began.add(key, self._turn)
            for key in turned:
                self._turned(key)
            self.new = new
            if new and len(new) * len(holds) > FEW:
                self._timeline.spend(len(new) * len(holds))
            self.changes += [self._key(phi, psi) for psi in new for phi in holds]

    def _turned(self, phi: Key) -> None:
        """Take in that φ began to hold at a key, or ceased to with the step before."""
        before = self._last.get(phi)
        self._note(partial(self._put_back, phi, before))
        if phi in self._holds.times:
            self._holds.remove(phi)
            self._last[phi] = self._turn - 1, self._timeline.before
        else:
            self._holds.add(phi, 0)
            self._last[phi] = self._turn, self._timeline.now
            self.changes.append(self._key(phi, None))

    def _put_back(self, phi: Key, before: tuple[int, int] | None) -> None:
        if before is None:
            del self._last[phi]
        else:
            self._last[phi] = before

    def _note(self, undo: partial[Any]) -> None:
        if self._timeline.journal is not None:
            self._timeline.journal.append(undo)

    def _key(self, phi: Key, psi: Key) -> Key:
        """The key with these values; where ψ's is None, with fresh ones, which stand for all."""
        texts: list[Text] = [None] * len(self.variables)
        for place, text in zip(self._phi_places, texts_of(phi), strict=True):
            texts[place] = text
        if psi is not None:
            for place, text in zip(self._psi_places, texts_of(psi), strict=True):
                texts[place] = text
        return tuple(texts)

    def _of_phi(self, region: Region) -> Key:
        return key_of([region[p] for p in self._phi_places])

    def _of_psi(self, region: Region) -> Key:
        return key_of([region[p] for p in self._psi_places])

    def at(self, key: Key) -> bool:
        """The value at a key."""
        since, last = self.began.times.get(self._of_psi(key)), self.last(self._of_phi(key))
        return since is not None and last is not None and last >= since

    def last(self, phi: Key) -> int | None:
        """The last turn at which φ held at a key, None for never."""
        if phi in self._holds.times:
            return self._turn
        found = self._last.get(phi)
        return None if found is None else found[0]

    def when(self, key: Key) -> int | None:
        """The time of a step that makes it hold at a key; None where it does not."""
        if not self.at(key):
            return None
        phi = self._of_phi(key)
        return self._timeline.now if phi in self._holds.times else self._last[phi][1]

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
        if place in self._psi_places:
            return self._began_in(region, self._psi_places.index(place))
        inner = self._phi_places.index(place)
        psi = [region[p] for p in self._psi_places]
        if ALL not in psi and key_of(psi) not in self.began.times:
            return ()
        if len(self._phi_places) == 1:
            return self._last
        self._timeline.spend(len(self._last))
        wanted = [(i, region[p]) for i, p in enumerate(self._phi_places) if region[p] is not ALL and p != place]
        return {phi[inner] for phi in self._last if all(phi[i] == text for i, text in wanted)}

    def _began_in(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of ψ's keys in a region that had begun when φ last held there."""
        phi = [region[p] for p in self._phi_places]
        psi = [region[p] for p in self._psi_places]
        psi[place] = ALL
        if ALL in phi:
            return self.began.spread(psi, place)
        last, times = self.last(key_of(phi)), self.began.times
        if last is None:
            return ()
        if all(text is ALL for text in psi):
            found: Collection[Key] = list(takewhile(lambda key: times[key] <= last, times))
        else:
            found = [key for key in self.began.within(psi) if times[key] <= last]
        if len(found) > FEW:
            self._timeline.spend(len(found))
        return {texts_of(key)[place] for key in found}

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        return None if self.began.times and self._last else False

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [list(self.began.times.items()), list(self._holds.times), list(self._last.items()), self._turn]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        began, holds, last, self._turn = data
        for key, turn in began:
            self.began.add(read_key(key), turn)
        for key in holds:
            self._holds.add(read_key(key), 0)
        self._last.update((read_key(key), (turn, time)) for key, (turn, time) in last)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which one of its parts held, and those that are distinguished below."""
        own = (
            texts_at(self._last, self._phi.variables, variable),
            texts_at(self.began.times, self._psi.variables, variable),
        )
        return chain(*own, self._phi.apart(variable), self._psi.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """True once it holds; false where one of its parts never will again."""
        if self.at(key):
            return True
        sides = self._phi.settled[0](self._of_phi(key)), self._psi.settled[0](self._of_psi(key))
        return False if False in sides else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        sides = self._phi.can_settle[0](fresh), self._psi.can_settle[0](fresh)
        return fresh.isdisjoint(self.variables), sides[0][1] or sides[1][1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self.began.index()
