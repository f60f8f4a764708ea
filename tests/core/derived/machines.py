"""Machines read literally: by what was written, not by the table that is made of it; all ways where it is not known."""

from __future__ import annotations

import re
from collections.abc import Collection, Hashable, Iterator, Sequence
from functools import cache
from itertools import chain, combinations, product
from typing import Any, NamedTuple

from oracle_server.core.atoms import canonical
from oracle_server.core.derived.definition import Definition
from oracle_server.core.machines.table import Table

SEQUENCES = {
    "e0 (e1 | e2)* e0": "a(b|c)*a",
    "e0? e1+ (e2 e0){0,2}": "a?b+(ca){0,2}",
    "!(e0 e1) & (e0 | e1){2,3}": "(?!ab$)(a|b){2,3}",
    "(e0 e1 | e1 e0)* e2": "(ab|ba)*c",
}
"""Sequences, and the same for `re`, where the events are letters."""
_SOURCES: dict[int, tuple[Table, Any]] = {}
"""What tables were made of, by their identity."""
_AHEAD = 4
"""Letters by which what may still follow is told; the machines above have few states."""


class Events(NamedTuple):
    """The events that hold at a step, and those of which it is not known."""

    held: Sequence[str]
    unsure: Sequence[str]


class _Unknown:
    """A state that is not known."""


UNKNOWN = _Unknown()
BLIND = _Unknown()
"""A sample that may be of any machine."""


def noted(table: Table, source: Any) -> Table:
    """The table, of which is noted what it was made of."""
    _SOURCES[id(table)] = table, source
    return table


def value_of(d: Definition, samples: Sequence[tuple[Any, Any]]) -> object:
    """What the signal is behind these samples: one that is neither events nor a value may have been of another key."""
    assert d.table is not None
    source = _SOURCES[id(d.table)][1]
    kinds: dict[str, Any] = {"states": _States, "follows": _Values, "sequence": _Words}
    kind = kinds[d.op](source, d.table.events)
    found = {kind.start}
    for step, sample in samples:
        blind = sample is BLIND or (len(d.by) == 1 and d.by[0] not in step.seen)
        found = {*kind.all} if blind else {to for state in found for to in kind.ways(state, sample)}
    values = {kind.value(state) for state in found}
    return values.pop() if len(values) == 1 else UNKNOWN


class _States:
    start: Any = "a"

    def __init__(self, source: Any, _events: Sequence[str]) -> None:
        self.rows, self.otherwise = source

    @property
    def all(self) -> Collection[Hashable]:
        return {*self.rows, "error"}

    def value(self, state: str) -> str:
        return state

    def ways(self, state: Any, sample: Events) -> Iterator[Any]:
        for more in _subsets(sample.unsure):
            yield self.next(state, {*sample.held, *more})

    def next(self, state: str, held: Collection[str]) -> str:
        if not held:
            return state
        for event, to in self.rows.get(state, {}).items():
            if event in held:
                return str(to)
        return state if state == "error" or self.otherwise == "stay" else self.otherwise


class _Values:
    start: Any = (None, False)

    def __init__(self, source: Any, _events: Sequence[str]) -> None:
        self.successors = source

    @property
    def all(self) -> Collection[Hashable]:
        return [self.start, *((value, bad) for value in (*self.successors, "…") for bad in (False, True))]

    def value(self, state: tuple[str | None, bool]) -> str | None:
        return "error" if state[1] or state[0] == "…" else state[0]

    def ways(self, state: tuple[str | None, bool], sample: Any) -> Iterator[Any]:
        if not isinstance(sample, str | bool | int | float):
            yield from (self.next(state, value) for value in (*self.successors, "…"))
            return
        text = sample if isinstance(sample, str) else canonical(sample)
        yield self.next(state, text if text in self.successors else "…")

    def next(self, state: tuple[str | None, bool], value: str) -> tuple[str, bool]:
        seen, bad = state
        if seen == value:
            return value, bad
        if seen is None:
            return value, value == "…"
        return value, value not in self.successors.get(seen, ())


class _Words:
    """A state is a word that leads to it, the shortest and first of those behind which the same may follow."""

    def __init__(self, source: str, events: Sequence[str]) -> None:
        self.source = source
        self.letters = {event: "abc"[int(event[1])] for event in events}
        self.alphabet = "".join(sorted(self.letters.values()))
        self.start: Any = _shortest(source, self.alphabet, "")

    @property
    def all(self) -> Collection[Hashable]:
        words = ("".join(w) for n in range(_AHEAD + 1) for w in product(self.alphabet, repeat=n))
        return {_shortest(self.source, self.alphabet, word) for word in words}

    def value(self, word: str) -> str:
        if re.fullmatch(self.source, word):
            return "matched"
        return "possible" if any(_future(self.source, self.alphabet, word)) else "failed"

    def ways(self, word: Any, sample: Events) -> Iterator[Any]:
        for more in _subsets(sample.unsure):
            held = [letter for event, letter in self.letters.items() if event in {*sample.held, *more}]
            nexts = [word + letter for letter in held]
            viable = [each for each in nexts if self.value(each) != "failed"]
            yield _shortest(self.source, self.alphabet, (viable or nexts or [word])[0])


@cache
def _future(source: str, alphabet: str, word: str) -> tuple[bool, ...]:
    ends = ("".join(w) for n in range(_AHEAD + 1) for w in product(alphabet, repeat=n))
    return tuple(bool(re.fullmatch(source, word + end)) for end in ends)


@cache
def _shortest(source: str, alphabet: str, word: str) -> str:
    wanted = _future(source, alphabet, word)
    words = ("".join(w) for n in range(len(word) + 1) for w in product(alphabet, repeat=n))
    return next(each for each in words if _future(source, alphabet, each) == wanted)


def _subsets(names: Sequence[str]) -> Iterator[tuple[str, ...]]:
    return chain.from_iterable(combinations(names, n) for n in range(len(names) + 1))
