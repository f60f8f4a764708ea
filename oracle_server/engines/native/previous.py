"""`pre`: the value of one step before."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from itertools import chain
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.keys import ALL, Key, Region, is_fresh, key_of, read_key
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.tables import table
from oracle_server.engines.native.timeline import Timeline


class _Value:
    __slots__ = ("value",)

    def __init__(self, value: bool) -> None:
        self.value = value

    def copy(self) -> _Value:
        return _Value(self.value)


def _same(one: _Value, other: _Value) -> bool:
    return one.value is other.value


class Previous:
    """Keeps what its operand was, and at the next step becomes that."""

    def __init__(self, body: Body, timeline: Timeline) -> None:
        self._body, self._timeline = body, timeline
        self._operand = body.at[0]
        self.variables, self.flat = body.variables, body.flat
        self.binds = body.binds if body.flat else frozenset()
        self.multiplies, self.lasting = body.multiplies, body.lasting
        self.changes: list[Key] = []
        self._table = table(len(self.variables), _Value(False), _Value.copy, timeline, flat=self.flat)
        self.next: list[tuple[Key, bool]] = []
        """What the operand became with the last step, keys with fresh values last."""

    def at(self, key: Key) -> bool:
        """The value at a key."""
        return self._table.get(key).value

    def step(self) -> None:
        """Become what the operand was, and take what it became."""
        if self.changes:
            self.changes = []
        if self._timeline.journal is not None:
            self._timeline.journal.append(partial(setattr, self, "next", self.next))
        if self.next:
            self._become()
        self.next = [(key, self._operand(key)) for key in self._body.touched(self._table)]

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        return 0 if self.next else None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """The keys that are distinguished."""
        return self._table.points()

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that are distinguished at a place of a region."""
        return self._table.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        return self._table.fresh.value if len(self._table.states) <= (not self.flat) else None

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [[(key, state.value) for key, state in self._table.items()], self.next]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        states, following = data
        self._table.load([(read_key(key), _Value(value)) for key, value in states])
        self.next = [(read_key(key), value) for key, value in following]

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished here, will be with the next step, or are below."""
        own = chain(self._table.keys(), (key for key, _ in self.next))
        return chain(texts_at(own, self.variables, variable), self._body.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """The operand's value, once it is settled and this has become that."""
        value = self._body.settled[0](key)
        return value if value is self.at(key) else None

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        return self._body.can_settle[0](fresh)

    def index(self) -> None:
        """Prepare for `spread`."""
        self._table.index()

    def _become(self) -> None:
        fresh = False
        for key, value in self.next:
            state = self._table.own(key)
            if state.value is not value:
                state.value = value
                if self._timeline.journal is not None:
                    self._timeline.journal.append(partial(setattr, state, "value", not value))
                self.changes.append(key)
            fresh = fresh or is_fresh(key)
        if fresh:
            self._timeline.spend(len(self._table.states))
        for key in self._table.keys() if fresh else [key for key, _ in self.next]:
            self._table.drop(key, _same)
