"""Keys by the values at some of their places."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from oracle_server.engines.native.keys import Key, key_of, texts_of


class Within:
    """Keys by the values at some of their places."""

    def __init__(self, places: Sequence[int]) -> None:
        self._places = places
        self._by: dict[Key, dict[Key, None]] = {}

    def add(self, key: Key) -> None:
        """Take in a key."""
        self._by.setdefault(self._part(key), {})[key] = None

    def remove(self, key: Key) -> None:
        """Forget a key."""
        part = self._part(key)
        del self._by[part][key]
        if not self._by[part]:
            del self._by[part]

    def keys(self, part: Key) -> Collection[Key]:
        """The keys with these values."""
        return self._by.get(part, ())

    def _part(self, key: Key) -> Key:
        texts = texts_of(key)
        return key_of([texts[place] for place in self._places])
