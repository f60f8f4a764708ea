"""`exists`, for the variables of quantifiers that follow each other: the keys at which the body holds."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from functools import partial
from itertools import chain, product
from typing import Any

from oracle_server.engines.native.body import Body
from oracle_server.engines.native.keys import (
    ALL,
    Key,
    Region,
    Text,
    Variables,
    fresh_key,
    is_fresh,
    key_of,
    read_key,
    texts_of,
)
from oracle_server.engines.native.nodes import texts_at
from oracle_server.engines.native.tables import Flat, Tree, table
from oracle_server.engines.native.timeline import FEW, Timeline


class Some:
    """A quantifier that binds all variables of its body.

    Of the keys at which the body holds, `held` has those that no more general one of them stands for.
    """

    __slots__ = ("_body", "_operand", "_timeline", "changes", "flat", "held", "variables")
    binds: frozenset[int] = frozenset()
    multiplies = lasting = False

    def __init__(self, body: Body, timeline: Timeline) -> None:
        self._body, self._timeline = body, timeline
        self._operand = body.at[0]
        self.variables: Variables = ()
        self.flat = True
        self.changes: list[Key] = []
        self.held: set[Key] = set()

    def at(self, key: Key) -> bool:  # noqa: ARG002 -- it has one value
        """The value."""
        return bool(self.held)

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        keys = self._body.touched(self)
        if keys:
            held, operand = self.held, self._operand
            before = bool(held)
            for key in _general_first(keys):
                if (operand(key) and not _covered(key, held, self._timeline)) is not (key in held):
                    _turn(held, key)
                    if self._timeline.journal is not None:
                        self._timeline.journal.append(partial(_turn, held, key))
            if not self._body.flat:
                self._timeline.tell_apart(len(held))
            if bool(held) is not before:
                self.changes = [()]

    def due(self) -> int | None:
        """Never by itself."""
        return None

    def next_deadline(self, after: int) -> int | None:  # noqa: ARG002
        """None: time alone changes nothing."""
        return None

    def points(self) -> Collection[Key]:
        """The keys at which the body holds."""
        return self.held

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts at a place of these keys in a region."""
        return _texts(self.held, region, place, self._timeline)

    def constant(self, region: Region) -> bool | None:  # noqa: ARG002
        """The value."""
        return bool(self.held)

    def keys(self, key: Key) -> Collection[Key]:  # noqa: ARG002
        """The keys of the body's variables at which it holds."""
        return self.held

    @property
    def body_variables(self) -> Variables:
        """The variables of `keys`."""
        return self._body.variables

    def snapshot(self) -> Any:
        """The state as plain data."""
        return list(self.held)

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.held = {read_key(key) for key in data}

    def apart(self, variable: int) -> Iterator[str]:  # noqa: ARG002
        """None: it has one value."""
        return iter(())

    def settled(self, key: Key) -> bool | None:  # noqa: ARG002
        """True where the body has settled so at a key, false where it has at all."""
        return settled_over(self._body, self.held)

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        bound = frozenset(self._body.variables)
        return self._body.can_settle[0](fresh)[0], self._body.can_settle[0](fresh | bound)[1]

    def index(self) -> None:
        """Nothing to prepare."""


class _Held:
    """The keys of the bound variables at which the body holds; `value` is the last value reported."""

    __slots__ = ("keys", "value")

    def __init__(self) -> None:
        self.keys: set[tuple[str | None, ...]] = set()
        self.value = False

    def copy(self) -> _Held:
        other = _Held()
        other.keys, other.value = self.keys.copy(), self.value
        return other


def _same(one: _Held, other: _Held) -> bool:
    return one.keys == other.keys


class SomeOf:
    """A quantifier whose body has free variables: what `Some` is, for each of their keys."""

    def __init__(self, body: Body, bound: int, timeline: Timeline) -> None:
        """`bound` is how many of the body's variables it binds, which are the last ones."""
        self._body, self._timeline = body, timeline
        self._operand = body.at[0]
        self._own = len(body.variables) - bound
        self.variables = body.variables[: self._own]
        self.flat = body.flat or self._own == 1
        self.binds = body.binds.intersection(self.variables) if self.flat else frozenset()
        self.multiplies, self.lasting = body.multiplies, body.lasting
        self.changes: list[Key] = []
        self._table = table(self._own, _Held(), _Held.copy, timeline, flat=self.flat)
        self._asked = _Asked(self._table, self._own, bound, timeline)

    def at(self, key: Key) -> bool:
        """The value at a key of the free variables."""
        return self._table.get(key).value

    def step(self) -> None:
        """Take what changed below."""
        if self.changes:
            self.changes = []
        keys = self._body.touched(self._asked)
        if not keys:
            return
        owns: dict[Key, _Held] = {}
        for key in sorted(self._with_rest(keys), key=self._turns):
            own = key_of(key[: self._own])
            held = owns[own] = self._table.own(own)
            rest = key[self._own :]
            if (self._operand(key) and not _covered(rest, held.keys, self._timeline)) is not (rest in held.keys):
                _turn(held.keys, rest)
                if not self._body.flat:
                    self._timeline.tell_apart(len(held.keys))
                if self._timeline.journal is not None:
                    self._timeline.journal.append(partial(_turn, held.keys, rest))
        self._tell(owns)

    def _tell(self, owns: dict[Key, _Held]) -> None:
        """Record where the value changed, and stop distinguishing keys that have become the same."""
        fresh = False
        for own, held in owns.items():
            if bool(held.keys) is not held.value:
                held.value = not held.value
                if self._timeline.journal is not None:
                    self._timeline.journal.append(partial(setattr, held, "value", not held.value))
                self.changes.append(own)
            fresh = fresh or is_fresh(own)
        if fresh:
            self._timeline.spend(len(self._table.states))
        for own in self._table.keys() if fresh else list(owns):
            self._table.drop(own, _same)

    def _turns(self, key: Key) -> tuple[list[bool], list[bool]]:
        """Free variables first where they are distinguished, bound ones first where they are not."""
        return [text is None for text in key[: self._own]], [text is not None for text in key[self._own :]]

    def _with_rest(self, keys: Collection[Key]) -> Collection[Key]:
        """The keys; where the last one stands for all others, also its keys with free variables distinguished."""
        if not self._body.flat or not is_fresh(last := list(keys)[-1]):
            return keys
        for key in keys:
            self._table.own(key_of(key[: self._own]))
        rest = last[self._own :]
        self._timeline.spend(len(self._table.states))
        return [*keys, *((*texts_of(own), *rest) for own in self._table.points())]

    def due(self) -> int | None:
        """Never by itself."""
        return None

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
        return self._table.fresh.value if len(self._table.states) <= (not self._table.flat) else None

    def keys(self, key: Key) -> Collection[Key]:
        """The keys of the body's variables at which it holds, for a key of the free ones."""
        own = texts_of(key)
        return [(*own, *bound) for bound in self._table.get(key).keys]

    @property
    def body_variables(self) -> Variables:
        """The variables of `keys`."""
        return self._body.variables

    def snapshot(self) -> Any:
        """The state as plain data."""
        return [(own, list(held.keys), held.value) for own, held in self._table.items()]

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        states = []
        for own, keys, value in data:
            held = _Held()
            held.keys, held.value = {tuple(key) for key in keys}, value
            states.append((read_key(own), held))
        self._table.load(states)

    def apart(self, variable: int) -> Iterator[str]:
        """The texts that are distinguished here or below."""
        return chain(texts_at(self._table.points(), self.variables, variable), self._body.apart(variable))

    def settled(self, key: Key) -> bool | None:
        """True where the body has settled so at some key of the bound variables, false where it has at all of them."""
        own = texts_of(key)
        return settled_over(self._body, [(*own, *bound) for bound in self._table.get(key).keys], own)

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        bound = frozenset(self._body.variables[self._own :])
        return self._body.can_settle[0](fresh)[0], self._body.can_settle[0](fresh | bound)[1]

    def index(self) -> None:
        """Prepare for `spread`."""
        self._table.index()


class _Asked:
    """What a `SomeOf` distinguishes, as keys of all variables of its body."""

    def __init__(self, table: Flat[_Held] | Tree[_Held], own: int, bound: int, timeline: Timeline) -> None:
        self._table, self._own, self._timeline = table, own, timeline
        self._fresh = texts_of(fresh_key(bound))

    def points(self) -> Collection[Key]:
        found: set[Key] = set()
        for own, held in self._table.items():
            self._timeline.spend(1 + len(held.keys))
            texts = texts_of(own)
            found.update((*texts, *bound) for bound in held.keys)
            found.add((*texts, *self._fresh))
        return found

    def spread(self, region: Region, place: int) -> Collection[str]:
        if place < self._own:
            return self._table.spread(region[: self._own], place)
        held = self._table.get(key_of(region[: self._own]))
        return _texts(held.keys, region[self._own :], place - self._own, self._timeline)


def settled_over(body: Body, held: Collection[Key], own: Sequence[Text] = ()) -> bool | None:
    """What `exists` has settled on, over keys that begin with these texts; `held` are those at which its body holds."""
    settled = body.settled[0]
    body.look_at(len(held))
    if held:
        return True if any(map(settled, held)) or body.all_settled(True, some=True, own=own) else None
    size = len(body.variables) - len(own)
    if settled(key_of([*own, *texts_of(fresh_key(size))])) is not False:
        return None
    return False if body.all_settled(False, some=False, own=own) else None


def _general_first(keys: Collection[Key]) -> Collection[Key]:
    return keys if len(keys) < 2 else sorted(keys, key=lambda key: [text is not None for text in texts_of(key)])


def _covered(key: Key, held: set[Key], timeline: Timeline) -> bool:
    """Whether a more general key is among those held."""
    if not isinstance(key, tuple):
        return key is not None and None in held
    if len(held) < 2 ** len(key):
        if len(held) > FEW:
            timeline.spend(len(held))
        return any(general != key and _covers(general, key) for general in held)
    choices = [(text,) if text is None else (text, None) for text in key]
    return any(general in held for general in product(*choices) if general != key)


def _covers(general: Key, key: Key) -> bool:
    """Whether a key of several variables is, but for fresh values, another one."""
    return all(text is None or text == other for text, other in zip(general, key, strict=True))


def _turn(keys: set[Key], key: Key) -> None:
    """Put a key in or take it out."""
    if key in keys:
        keys.discard(key)
    else:
        keys.add(key)


def _texts(keys: Collection[Key], region: Region, place: int, timeline: Timeline) -> Collection[str]:
    """The texts at a place of the keys in a region."""
    if len(keys) > FEW:
        timeline.spend(len(keys))
    fixed = [(i, text) for i, text in enumerate(region) if text is not ALL and i != place]
    return {
        text
        for key in map(texts_of, keys)
        if (text := key[place]) is not None and all(key[i] == wanted for i, wanted in fixed)
    }
