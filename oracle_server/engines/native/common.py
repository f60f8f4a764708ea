"""Whether parts of a conjunction hold for a value in common, from the values that each of them holds for by itself.

In `exists[l]. kept(t, x, l) and kept(u, x, l)` the locks that one thread keeps at one variable are found once, and not
again for each other thread: whether two of them have one in common is a matter of two sets.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence, Set
from functools import reduce
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.expressions import Expression
from oracle_server.engines.native.keys import ALL, Key, Region, Text, Variables, key_of, picker, texts_of
from oracle_server.engines.native.timeline import FEW, Timeline, Undo

_MOST = 50_000
"""Sets that a part keeps, of some 500 bytes each."""
_LIGHT = 64
"""Values of a set that cost no more to look at than a key costs by itself."""

Values = tuple[bool, frozenset[str]]
"""Where something holds: at these texts alone or, where the first is true, at all others, a fresh value among them."""


class Common:
    """The parts of a conjunction, by what they have in common: one variable, which is the last one."""

    def __init__(self, parts: Sequence[Expression], variables: Variables, timeline: Timeline) -> None:
        """`variables` are the others. A part without the last one holds for all of its values, or for none."""
        self._timeline = timeline
        bodies = [Body(timeline, part) for part in parts]
        shared = set(variables).intersection(*(body.variables for body in bodies))
        self._shares = [_Share(body, variables, shared, timeline) for body in bodies]

    def step(self) -> None:
        """Forget what may have changed with this step."""
        for share in self._shares:
            share.step()

    def at(self, key: Key) -> bool:
        """Whether all parts hold for one value, at a key of the other variables."""
        return _is_somewhere(_all_of(share.at(key) for share in self._shares))

    def among(self, region: Region, place: int, texts: Collection[str]) -> set[str]:
        """Of texts at the only place that a region leaves open, those at which they do."""
        key: list[Any] = [*region]
        key[place] = None
        fixed = _all_of(share.at(key_of(key)) for share in self._shares if place not in share.places)
        asked = [share for share in self._shares if place in share.places]
        if len(asked) == 1 and not fixed[0]:
            row = asked[0].row(key, place, texts)
            if row is not None:
                return set(texts).intersection(row.meeting(fixed[1], self._timeline))
        found = set[str]()
        for text in texts:
            key[place] = text
            if _is_somewhere(_all_of((fixed, *(share.at(key_of(key)) for share in asked)))):
                found.add(text)
        return found


class _Row:
    """Values of the last variable, for many values of another one."""

    __slots__ = ("by", "most", "values")

    def __init__(self) -> None:
        self.values: dict[Text, Values] = {}
        self.by: dict[str, set[Text]] = {}
        """By each value of the last variable, where it is listed as one of those at which the part holds."""
        self.most: set[Text] = set()
        """Where it holds at most values."""

    def add(self, text: Text, values: Values) -> None:
        self.values[text] = values
        if values[0]:
            self.most.add(text)
            return
        for value in values[1]:
            self.by.setdefault(value, set()).add(text)

    def remove(self, text: Text) -> bool:
        """Forget a text; whether it was there."""
        if text not in self.values:
            return False
        most, values = self.values.pop(text)
        if most:
            self.most.discard(text)
            return True
        for value in values:
            self.by[value].discard(text)
            if not self.by[value]:
                del self.by[value]
        return True

    def meeting(self, values: frozenset[str], timeline: Timeline) -> set[Text]:
        """The texts for which it holds at one of some values."""
        lists = [self.by[value] for value in values if value in self.by]
        looked = sum(map(len, lists)) + len(values) * len(self.most)
        if looked >= _LIGHT:
            timeline.spend(looked // _LIGHT)
        return {text for text in self.most if not values <= self.values[text][1]}.union(*lists)


class _Share:
    """A part, and for the keys that it was asked for the values of the last variable at which it holds."""

    def __init__(self, body: Body, variables: Variables, shared: Set[int], timeline: Timeline) -> None:
        """`shared` are variables that other parts have as well: it is asked for many values of another one at once."""
        self._body, self._timeline = body, timeline
        self._operand = body.at[0]
        own = [v for v in body.variables if v in variables]
        self.places = [variables.index(v) for v in own]
        self._pick = picker(self.places, len(variables))
        self._has_last = len(own) < len(body.variables)
        self._many = next((place for place, v in enumerate(own) if v not in shared), 0)
        self._rows: dict[Key, _Row] = {}
        self._kept = 0

    def step(self) -> None:
        """Forget what may have changed with this step."""
        for region in self._body.narrowed():
            own = region[: len(self.places)]
            if ALL in own:
                self._clear()
            else:
                self._forget(own)

    def at(self, key: Key) -> Values:
        """The values of the last variable, at a key of the others."""
        own = texts_of(key if self._pick is None else self._pick(key)) if self.places else ()
        text, rest = self._divided(own)
        row = self._rows.get(rest)
        found = None if row is None else row.values.get(text)
        if found is None:
            self._make_room(1)
            found = self._find(own)
        return found

    def row(self, key: Sequence[Any], place: int, texts: Collection[str]) -> _Row | None:
        """What is known of texts at a place, beside those of a key; None where that is not kept so, or too much."""
        if place != self.places[self._many] or len(texts) > _MOST:
            return None
        own = [key[p] for p in self.places]
        _, rest = self._divided(own)
        row = self._rows.get(rest)
        missing = texts if row is None else set(texts).difference(row.values)
        if missing and self._make_room(len(missing)):
            missing = texts
        for text in missing:
            own[self._many] = text
            self._find(tuple(own))
        return self._rows.get(rest)

    def _divided(self, own: Sequence[Text]) -> tuple[Text, Key]:
        """The text of which a row has many, and the others."""
        many = self._many
        return (own[many], (*own[:many], *own[many + 1 :])) if own else (None, ())

    def _find(self, own: tuple[Text, ...]) -> Values:
        """Find the values for a key, and keep them."""
        holds = self._operand
        if self._has_last:
            spread = self._body.spread([*own, ALL], len(own))
            if len(spread) > FEW:
                self._timeline.spend(len(spread))
            fresh = holds(key_of([*own, None]))
            found: Values = (fresh, frozenset(text for text in spread if holds(key_of([*own, text])) is not fresh))
        else:
            found = (holds(key_of(own)), frozenset())
        text, rest = self._divided(own)
        self._rows.setdefault(rest, _Row()).add(text, found)
        self._kept += 1
        if self._timeline.journal is not None:  # where this step is taken back, so is what it was found by
            self._timeline.journal.append(Undo(self._forget, own))
        return found

    def _make_room(self, more: int) -> bool:
        """Whether all had to be forgotten for some more."""
        if self._kept + more <= _MOST:
            return False
        self._clear()
        return True

    def _clear(self) -> None:
        self._rows.clear()
        self._kept = 0

    def _forget(self, own: tuple[Text, ...]) -> None:
        text, rest = self._divided(own)
        row = self._rows.get(rest)
        if row is not None and row.remove(text):
            self._kept -= 1
            if not row.values:
                del self._rows[rest]


def _all_of(values: Iterable[Values]) -> Values:
    everywhere: Values = (True, frozenset())
    return reduce(_both, values, everywhere)


def _both(one: Values, other: Values) -> Values:
    if one[0]:
        return (other[0], one[1] | other[1]) if other[0] else (False, other[1] - one[1])
    return False, one[1] - other[1] if other[0] else one[1] & other[1]


def _is_somewhere(values: Values) -> bool:
    return values[0] or bool(values[1])
