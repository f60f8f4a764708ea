"""`once[a:]` of what can't hold for fresh values: the keys at which it held, and a queue of those that must wait."""

from __future__ import annotations

from collections.abc import Collection

from oracle_server.engines.native.body import NOTHING, Body
from oracle_server.engines.native.clock import Clock
from oracle_server.engines.native.keys import ALL, Key, Region, key_of
from oracle_server.engines.native.tables import Index


class Ever:
    """Once it holds at a key, it holds there for ever."""

    __slots__ = ("_at", "_body", "_clock", "_index", "_lower", "at", "changes", "flat", "held", "variables", "waiting")

    def __init__(self, body: Body, lower: int, clock: Clock) -> None:
        self._body, self._lower, self._clock = body, lower, clock
        self._at = body.at[0]
        self.variables = body.variables
        self.flat = True
        self.changes: list[Key] = []
        self.held: set[Key] = set()
        self.waiting: dict[Key, int] = {}
        """Where it held but not yet long enough ago: when it will have, in order."""
        self.at = self.held.__contains__
        self._index: Index | None = None

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        keys = self._body.touched(NOTHING)
        if keys:
            at, held = self._at, self.held
            for key in keys:
                if key not in held and at(key):
                    if self._lower:
                        self.waiting.setdefault(key, self._clock.now + self._lower)
                    else:
                        self._hold(key)
        if self.waiting:
            self._release()

    def due(self) -> int | None:
        """When this must be stepped even if nothing changes below."""
        return next(iter(self.waiting.values()), None)

    def points(self) -> Collection[Key]:
        """The keys at which it holds."""
        return self.held

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        if len(self.variables) == 1:
            return self.held
        if self._index is None:
            self.index()
        assert self._index is not None  # noqa: S101 -- made just now
        return self._index.spread(region, place)

    def constant(self, region: Region) -> bool | None:
        """The value all over a region, None where it may differ."""
        if ALL not in region:
            return self.at(key_of(region))
        return None if self.held else False

    def index(self) -> None:
        """Be asked for `spread`."""
        if len(self.variables) > 1:
            self._index = Index(len(self.variables))
            for key in self.held:
                self._index.add(key)

    def _release(self) -> None:
        now = self._clock.now
        while self.waiting:
            key = next(iter(self.waiting))
            if self.waiting[key] > now:
                return
            del self.waiting[key]
            self._hold(key)

    def _hold(self, key: Key) -> None:
        self.held.add(key)
        self.changes.append(key)
        if self._index is not None:
            self._index.add(key)
