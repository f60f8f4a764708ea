"""The keys at which something holds, where it can't hold for fresh values."""

from __future__ import annotations

from collections.abc import Collection
from functools import partial

from oracle_server.engines.native.keys import ALL, Key, Region, key_of
from oracle_server.engines.native.tables import Index
from oracle_server.engines.native.timeline import Timeline, Undo


class Held:
    """Keys without fresh values, each with a time."""

    __slots__ = ("_counted", "_index", "_size", "_timeline", "_unadd", "times")

    def __init__(self, size: int, timeline: Timeline, *, counted: bool = False) -> None:
        """`counted`: it may be given more keys with a step than events have values, so that there is an end to them."""
        self._counted = counted
        self._size, self._timeline = size, timeline
        self.times: dict[Key, int] = {}
        self._index: Index | None = None
        self._unadd = self._take
        """As it is noted, time and again."""

    def add(self, key: Key, time: int) -> None:
        """Take in a key that is not there. Raises `EngineError` where these are too many."""
        if self._counted:
            self._timeline.tell_apart(len(self.times) + 1)
        self._put(key, time)
        if self._timeline.journal is not None:
            self._timeline.journal.append(Undo(self._unadd, key))

    def remove(self, key: Key) -> None:
        """Forget a key that is there."""
        if self._timeline.journal is not None:
            self._timeline.journal.append(partial(self._put, key, self.times[key]))
        self._take(key)

    def points(self) -> Collection[Key]:
        """All of them."""
        return self.times

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        if self._size == 1:
            return self.times
        if self._index is None:
            self.index()
        assert self._index is not None  # noqa: S101 -- made just now
        return self._index.spread(region, place)

    def within(self, region: Region) -> Collection[Key]:
        """The keys in a region."""
        if ALL not in region:
            key = key_of(region)
            return (key,) if key in self.times else ()
        if self._size == 1:
            return self.times
        self.index()
        assert self._index is not None  # noqa: S101 -- made just now
        return self._index.within(region) if any(text is not ALL for text in region) else self.times

    def constant(self, region: Region) -> bool | None:
        """Whether it holds in all of a region, None where that may differ."""
        if ALL not in region:
            return key_of(region) in self.times
        return None if self.times else False

    def index(self) -> None:
        """Prepare for `spread`."""
        if self._size > 1 and self._index is None:
            self._index = Index(self._size, self._timeline)
            for key in self.times:
                self._index.add(key)

    def _put(self, key: Key, time: int) -> None:
        self.times[key] = time
        if self._index is not None:
            self._index.add(key)

    def _take(self, key: Key) -> None:
        del self.times[key]
        if self._index is not None:
            self._index.remove(key)
