"""Where something holds that can't hold for fresh values and, where it does not any more, when it last did.

Steps are compared by *turns*: the owner counts the steps at which something that it compares begins or ends. The times
of two steps may be equal.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from itertools import chain
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.held import Held
from oracle_server.engines.native.keys import ALL, Key, Region, key_of, read_key, texts_of
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.timeline import Timeline


class Standing:
    """The keys at which a body holds, and for those at which it did the last turn and time."""

    def __init__(self, body: Body, timeline: Timeline) -> None:
        """`body` is flat, and holds for no fresh values."""
        self.body, self._timeline = body, timeline
        self._at = body.at[0]
        self.variables = body.variables
        self._held = Held(len(body.variables), timeline)
        self.holds = self._held.times
        """Where it holds now."""
        self.last: dict[Key, tuple[int, int]] = {}
        """Where it ever held: the last turn at which it did, and the time, unless it holds now."""

    def turning(self) -> list[Key]:
        """The keys at which it begins or ceases to hold with this step."""
        at, holds = self._at, self.holds
        return [key for key in dict.fromkeys(self.body.touched(self._held)) if at(key) is not (key in holds)]

    def turn(self, key: Key, turn: int) -> None:
        """Take in that it begins to hold at a key, or that it last did with the step before."""
        self._note(partial(self._put_back, key, self.last.get(key)))
        if key in self.holds:
            self._held.remove(key)
            self.last[key] = turn - 1, self._timeline.before
        else:
            self._held.add(key, 0)
            self.last[key] = turn, self._timeline.now

    def forget(self, key: Key) -> None:
        """Know no more that it ever held at a key, at which it does not now."""
        self._note(partial(self.last.__setitem__, key, self.last.pop(key)))

    def turn_of(self, key: Key, turn: int) -> int | None:
        """The last turn at which it held at a key, None for never; `turn` is the present one."""
        if key in self.holds:
            return turn
        found = self.last.get(key)
        return None if found is None else found[0]

    def time_of(self, key: Key) -> int:
        """The time of the last step at which it held at a key, where it ever did."""
        return self._timeline.now if key in self.holds else self.last[key][1]

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region of its variables at which it ever held; it may be too many."""
        if len(self.variables) == 1:
            return self.last
        self._timeline.spend(len(self.last))
        wanted = [(i, text) for i, text in enumerate(region) if text is not ALL and i != place]
        return {key[place] for key in self.last if all(key[i] == text for i, text in wanted)}

    def apart(self, variable: int) -> Iterator[str]:
        """The texts at which it held, and those that are distinguished below."""
        return chain(texts_at(self.last, self.variables, variable), self.body.apart(variable))

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [list(self.holds), list(self.last.items())]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        holds, last = data
        for key in holds:
            self._held.add(read_key(key), 0)
        self.last.update((read_key(key), (turn, time)) for key, (turn, time) in last)

    def _put_back(self, key: Key, before: tuple[int, int] | None) -> None:
        if before is None:
            del self.last[key]
        else:
            self.last[key] = before

    def _note(self, undo: Callable[[], object]) -> None:
        if self._timeline.journal is not None:
            self._timeline.journal.append(undo)


class Places:
    """Where the variables of a part stand among those of a whole with several variables."""

    def __init__(self, part: Collection[int], whole: Collection[int]) -> None:
        order = list(whole)
        self._size = len(order)
        self.places = [order.index(v) for v in part]

    def of(self, region: Region) -> Key:
        """The part of a key."""
        return key_of([region[p] for p in self.places])

    def region(self, region: Region) -> Region:
        """The part of a region."""
        return [region[p] for p in self.places]

    def whole(self, key: Key) -> Key:
        """The key with the part's values, and fresh ones elsewhere, which stand for all."""
        texts: list[Any] = [None] * self._size
        for place, text in zip(self.places, texts_of(key), strict=True):
            texts[place] = text
        return tuple(texts)


def merged(one: Key, other: Key) -> Key | None:
    """The key that has the values of both, None where they differ in one; a fresh one stands for any."""
    texts = [q if p is None else p for p, q in zip(one, other, strict=True)]
    return tuple(texts) if all(q is None or q == t for q, t in zip(other, texts, strict=True)) else None
