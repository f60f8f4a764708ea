"""`Preceded`, and what else is asked of ψ's variable: its values for which all of that holds, in the order they began.

So `exit(y) and once (enter(y) and pre once enter(x)) and not pre once exit(x)` looks at the `x` that it holds for, and
not at all that ever entered.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Collection, Iterator
from functools import partial
from operator import itemgetter
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.expressions import Expression
from oracle_server.engines.native.keys import ALL, Key, Region, key_of
from oracle_server.engines.native.preceded import Preceded
from oracle_server.engines.native.timeline import Timeline

_turn = itemgetter(0)


class Outstanding:
    """Holds where a `Preceded` does, and an expression over the variable of its ψ."""

    flat = lasting = False
    multiplies = True

    def __init__(self, preceded: Preceded, also: Expression, timeline: Timeline) -> None:
        """`also` has that variable, and each of its nodes has."""
        self._preceded, self._also, self._timeline = preceded, Body(timeline, also), timeline
        self.variables, self.binds = preceded.variables, preceded.binds
        whole = self._whole = Body(timeline, ("and", preceded, also))
        self.at, self.constant, self.settled, self.can_settle = (
            whole.at[0], whole.constant[0], whole.settled[0], whole.can_settle[0]
        )  # fmt: skip
        (variable,) = self._also.variables
        self._place = self.variables.index(variable)
        self.changes: list[Key] = []
        self._turns: dict[Key, int] = {}
        self._order: list[tuple[int, Key]] = []
        """Where ψ and `also` hold, by when ψ began."""

    def step(self) -> None:
        """Take what changed below."""
        began, at = self._preceded.began.times, self._also.at[0]
        self.changes = [*self._preceded.changes]
        for key in {*self._also.touched(self._preceded.began), *self._preceded.new}:
            held = key in self._turns
            if (key in began and at(key)) is not held:
                turn = began[key]
                (self._remove if held else self._add)(turn, key)
                if self._timeline.journal is not None:
                    self._timeline.journal.append(partial(self._add if held else self._remove, turn, key))
                changed: list[Any] = [None] * len(self.variables)
                changed[self._place] = key
                self.changes.append(tuple(changed))

    def _add(self, turn: int, key: Key) -> None:
        self._turns[key] = turn
        insort(self._order, (turn, key))

    def _remove(self, turn: int, key: Key) -> None:
        del self._turns[key]
        del self._order[bisect_left(self._order, (turn, key))]

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place at which it can hold in a region."""
        if place != self._place:
            return self._preceded.spread(region, place)
        phi = [text for p, text in enumerate(region) if p != place]
        if ALL in phi:
            return self._turns
        last = self._preceded.last(key_of(phi))
        if last is None:
            return ()
        return [key for _, key in self._order[: bisect_right(self._order, last, key=_turn)]]

    def due(self) -> int | None:
        """Never by itself."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """Where ψ and the rest hold: it is not flat, and there is no list of its keys."""
        return self._turns

    def snapshot(self) -> Any:
        """The state as plain data."""
        return self._order

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self._order = [(turn, key) for turn, key in data]
        self._turns = {key: turn for turn, key in self._order}

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished below."""
        return self._whole.apart(variable)

    def index(self) -> None:
        """Nothing to prepare."""
