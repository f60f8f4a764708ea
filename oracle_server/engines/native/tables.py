"""States by key: one for each key that was distinguished, one for all others."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from functools import partial
from typing import Any, Generic, TypeVar, TypeVarTuple, Unpack

from oracle_server.engines.native.keys import ALL, Key, Region, fresh_key
from oracle_server.engines.native.timeline import FEW, Timeline, Undo

S = TypeVar("S")
Args = TypeVarTuple("Args")
_NO_TEXTS: frozenset[str] = frozenset()


class Index:
    """Keys of two variables and more by the texts in them."""

    __slots__ = ("_by", "_timeline")

    def __init__(self, size: int, timeline: Timeline) -> None:
        self._timeline = timeline
        self._by: list[dict[str, Key | set[Key]]] = [{} for _ in range(size)]
        """A key by itself where it is the only one with a text, as most are: a set for each would take 200 bytes."""

    def add(self, key: Key) -> None:
        """Take in a key."""
        for by, text in zip(self._by, key, strict=True):
            found = by.setdefault(text, key)
            if type(found) is set:
                found.add(key)
            elif found != key:
                by[text] = {found, key}

    def remove(self, key: Key) -> None:
        """Forget a key."""
        for by, text in zip(self._by, key, strict=True):
            found = by.get(text)
            if type(found) is set:
                found.discard(key)
                if len(found) == 1:
                    by[text] = found.pop()
            elif found == key:
                del by[text]

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        fixed = [(i, text) for i, text in enumerate(region) if text is not ALL and i != place]
        if not fixed:
            return self._by[place]
        return {key[place] for key in self._at(fixed)}

    def within(self, region: Region) -> Collection[Key]:
        """The keys in a region, which fixes one place or more."""
        return self._at([(i, text) for i, text in enumerate(region) if text is not ALL])

    def _at(self, fixed: list[tuple[int, Any]]) -> Collection[Key]:
        """The keys with these texts at these places."""
        fewest = min((self._keys(i, text) if text is not None else () for i, text in fixed), key=len)
        if len(fewest) > FEW:
            self._timeline.spend(len(fewest))
        if len(fixed) == 1:
            return fewest
        return [key for key in fewest if all(key[i] == text for i, text in fixed)]

    def _keys(self, place: int, text: Any) -> Collection[Key]:
        found = self._by[place].get(text, ())
        return found if type(found) is set or not found else (found,)


class Flat(Generic[S]):
    """States that differ from the fresh key's at finitely many keys without fresh values."""

    __slots__ = ("_copy", "_fresh_key", "_index", "_size", "_timeline", "fresh", "states")
    flat = True

    def __init__(self, size: int, fresh: S, copy: Callable[[S], S], timeline: Timeline) -> None:
        self.fresh, self._timeline = fresh, timeline
        self.states: dict[Key, S] = {}
        self._fresh_key = fresh_key(size)
        self._copy = copy
        self._size = size
        self._index: Index | None = None

    def get(self, key: Key) -> S:
        """The state at a key."""
        return self.states.get(key, self.fresh)

    def own(self, key: Key) -> S:
        """The state at a key, distinguished from now on."""
        if key == self._fresh_key:
            return self.fresh
        state = self.states.get(key)
        if state is None:
            state = self._copy(self.fresh)
            self._put(key, state)
            if self._timeline.journal is not None:
                self._timeline.journal.append(Undo(self._remove, key))
        return state

    def drop(self, key: Key, same: Callable[[S, S], bool]) -> None:
        """Stop distinguishing a key where its state is the same as the others'."""
        state = self.states.get(key)
        if state is not None and same(state, self.fresh):
            self._remove(key)
            if self._timeline.journal is not None:
                self._timeline.journal.append(partial(self._put, key, state))

    def known(self, key: Key) -> S | None:
        """The state of a key that is distinguished, None for others."""
        return self.fresh if key == self._fresh_key else self.states.get(key)

    def items(self) -> Iterator[tuple[Key, S]]:
        """All keys with their states, the fresh one first."""
        yield self._fresh_key, self.fresh
        yield from list(self.states.items())

    def keys(self) -> list[Key]:
        """All keys, the fresh one first."""
        return [self._fresh_key, *self.states]

    def beneath(self, key: Key) -> list[Key]:  # noqa: ARG002 -- a key with a fresh value is the fresh one here
        """The keys that may have been like one with a fresh value: all."""
        return self.keys()

    def points(self) -> Collection[Key]:
        """The keys that are distinguished."""
        return self.states.keys()

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of the keys in a region."""
        if self._size == 1:
            return self.states.keys()
        if self._index is None:
            self._timeline.spend(len(self.states))
            return Index.spread(_indexed(self._size, self.states, self._timeline), region, place)
        return self._index.spread(region, place)

    def load(self, states: list[tuple[Key, S]]) -> None:
        """Take these keys and states, the fresh one among them, in place of all others."""
        for key in list(self.states):
            self._remove(key)
        for key, state in states:
            if key == self._fresh_key:
                self.fresh = state
            else:
                self._put(key, state)

    def index(self) -> None:
        """Prepare for `spread`, before anything is distinguished."""
        if self._size > 1 and self._index is None:
            self._index = _indexed(self._size, self.states, self._timeline)

    def _put(self, key: Key, state: S) -> None:
        self.states[key] = state
        if self._index is not None:
            self._index.add(key)

    def _remove(self, key: Key) -> None:
        del self.states[key]
        if self._index is not None:
            self._index.remove(key)


def _indexed(size: int, keys: Collection[Key], timeline: Timeline) -> Index:
    index = Index(size, timeline)
    for key in keys:
        index.add(key)
    return index


class Tree(Generic[S]):
    """States by two variables and more that can differ along one variable for all values of another.

    A value that is distinguished at a place has a branch of its own; others share the fresh one's.
    """

    __slots__ = ("_branches", "_copy", "_fresh", "_size", "_timeline", "states")
    flat = False

    def __init__(self, size: int, fresh: S, copy: Callable[[S], S], timeline: Timeline) -> None:
        self._size, self._copy, self._timeline = size, copy, timeline
        self._fresh = fresh_key(size)
        self.states: dict[Key, S] = {self._fresh: fresh}
        self._branches: dict[Key, set[str]] = {}

    @property
    def fresh(self) -> S:
        """The state at the fresh key."""
        return self.states[self._fresh]

    def get(self, key: Key) -> S:
        """The state at a key."""
        return self.states[self._find(key)]

    def own(self, key: Key) -> S:
        """The state at a key, distinguished from now on."""
        path: Key = ()
        for text in key:
            if text is not None and text not in self._branches.get(path, ()):
                self._grow((*path, None), (*path, text))
                texts = self._branches.setdefault(path, set())
                texts.add(text)
                self._undo(texts.discard, text)
            path = (*path, text)
        return self.states[key]

    def drop(self, key: Key, same: Callable[[S, S], bool]) -> None:
        """Stop distinguishing a key where its branch is the same as that of the fresh value beside it."""
        for length in range(self._size, 0, -1):
            path = key[:length]
            if path[-1] is None:
                continue
            if not self._alike(path, (*path[:-1], None), same):
                return
            self._prune(path)
            texts = self._branches[path[:-1]]
            texts.discard(path[-1])
            self._undo(texts.add, path[-1])

    def known(self, key: Key) -> S | None:
        """The state of a key that is distinguished, None for others."""
        return self.states.get(key)

    def items(self) -> Iterator[tuple[Key, S]]:
        """All keys with their states, fresh ones first."""
        yield from sorted(self.states.items(), key=lambda item: [text is not None for text in item[0]])

    def keys(self) -> list[Key]:
        """All keys, fresh ones first."""
        return [key for key, _ in self.items()]

    def beneath(self, key: Key) -> list[Key]:
        """The keys on the branch of a key up to its first fresh value, fresh ones first: no others can be like it."""
        found = self._find(key)
        length = found.index(None) if None in found else self._size
        paths: list[Key] = [found[:length]]
        for _ in range(length, self._size):
            paths = [(*path, text) for path in paths for text in (None, *self._branches.get(path, ()))]
        return paths

    def points(self) -> Collection[Key]:
        """The keys that are distinguished, fresh values among them."""
        return self.states.keys()

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that are distinguished at a place of a region."""
        return self._branches.get(self._find(region[:place]), ())

    def load(self, states: list[tuple[Key, S]]) -> None:
        """Take these keys and states, the fresh one among them, in place of all others."""
        self.states, self._branches = dict(states), {}
        for key in self.states:
            for place, text in enumerate(key):
                if text is not None:
                    self._branches.setdefault(key[:place], set()).add(text)

    def index(self) -> None:
        """Nothing to prepare."""

    def _undo(self, take_back: Callable[[Unpack[Args]], object], *args: *Args) -> None:
        """Note what takes a change back."""
        if self._timeline.journal is not None:
            self._timeline.journal.append(partial(take_back, *args))

    def _find(self, key: Region) -> Key:
        path: Key = ()
        for text in key:
            path = (*path, text if text in self._branches.get(path, ()) else None)
        return path

    def _grow(self, source: Key, target: Key) -> None:
        """Copy all that grows on one branch to another."""
        if len(source) == self._size:
            self._timeline.spend(1)
            self._timeline.tell_apart(len(self.states) + 1)
            self.states[target] = self._copy(self.states[source])
            self._undo(self.states.pop, target)
            return
        texts = self._branches.get(source, set())
        if texts:
            self._branches[target] = set(texts)
            self._undo(self._branches.pop, target)
        for text in (None, *texts):
            self._grow((*source, text), (*target, text))

    def _alike(self, path: Key, other: Key, same: Callable[[S, S], bool]) -> bool:
        """Whether the same is distinguished on two branches, and all states on them are the same."""
        if len(path) == self._size:
            mine, others = self.states.get(path), self.states.get(other)
            return mine is not None and others is not None and same(mine, others)
        texts = self._branches.get(path, _NO_TEXTS)
        if texts != self._branches.get(other, _NO_TEXTS):
            return False
        return all(self._alike((*path, text), (*other, text), same) for text in (None, *texts))

    def _prune(self, path: Key) -> None:
        """Forget all that grows on a branch."""
        if len(path) == self._size:
            self._undo(self.states.__setitem__, path, self.states.pop(path))
            return
        texts = self._branches.pop(path, None)
        if texts is not None:
            self._undo(self._branches.__setitem__, path, texts)
        for text in (None, *(texts or ())):
            self._prune((*path, text))


def table(size: int, fresh: S, copy: Callable[[S], S], timeline: Timeline, *, flat: bool) -> Flat[S] | Tree[S]:
    """A table for keys of `size` variables."""
    return Flat(size, fresh, copy, timeline) if flat or size < 2 else Tree(size, fresh, copy, timeline)
