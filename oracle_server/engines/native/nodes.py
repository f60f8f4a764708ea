"""What the nodes of an engine have in common, and the atoms.

A node is a part of the formula that has a state: an atom, a temporal operator, a quantifier. What is between nodes
is Boolean and is computed on demand. At each step a node takes the keys at which the nodes below it changed, and
returns the keys at which it changed itself, so that a step costs what changes and not what is known.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, Protocol

from oracle_server.core.atoms import Match
from oracle_server.engines.native.keys import ALL, Key, Region, Variables, key_of, read_key, texts_of


class Node(Protocol):
    """A part of the formula with a state, as those above it see it.

    Where `flat`, its values are those at its fresh key but for finitely many keys without fresh values; otherwise they
    form a tree by variables, and `spread` alone tells where they differ.
    """

    variables: Variables
    flat: bool
    changes: list[Key]
    """The keys at which the value may have changed with this step; a fresh value stands for all."""
    at: Callable[[Key], bool]
    """The value at a key."""
    binds: frozenset[int]
    """Variables that have finitely many values where it holds, and none fresh; `spread` tells these in any region."""
    multiplies: bool
    """Whether it can come to hold at more keys with a step than events have values."""
    lasting: bool
    """Whether, where it once holds, it does from then on."""

    def points(self) -> Collection[Key]:
        """The keys other than the fresh one whose value may differ from the one there; for flat nodes."""
        ...

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The texts that distinguish values at a place of a region, where all before that place is no `ALL`."""
        ...

    def constant(self, region: Region) -> bool | None:
        """The value in all of a region, None where it may differ."""
        ...

    def index(self) -> None:
        """Prepare for `spread`."""
        ...

    def apart(self, variable: int) -> Iterator[str]:
        """The texts of a variable that may, now or later, have other values than its fresh one; some repeatedly."""
        ...

    def settled(self, key: Key) -> bool | None:
        """The value at a key, where no continuation can change it; None where one may, or that is not known."""
        ...

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:
        """Whether the value can settle on true, and on false, where these variables have fresh values."""
        ...


def texts_at(keys: Iterable[Key], variables: Variables, variable: int) -> Iterator[str]:
    """The texts that a variable has in keys, where it is one of theirs; the fresh one is none."""
    if variable not in variables:
        return iter(())
    place = variables.index(variable)
    return (text for key in keys if (text := texts_of(key)[place]) is not None)


class Absent:
    """Stands where an atom has no key since it does not hold."""


ABSENT = Absent()
"""The only one."""


class Leaf:
    """A node of the last step alone: where it holds now, and at which keys that has changed."""

    __slots__ = ("binds", "changes", "current")
    multiplies = lasting = False

    binds: frozenset[int]
    changes: list[Key]
    current: Key | Absent

    @property
    def holds(self) -> bool:
        """Whether it holds at some key."""
        return self.current is not ABSENT

    @property
    def idle(self) -> bool:
        """Whether it neither holds nor has just changed."""
        return self.current is ABSENT and not self.changes


class AtomNode(Leaf):
    """An atom: holds at one key at most."""

    __slots__ = ("_pick", "_repeated", "flat", "variables")

    def __init__(self, variables: Variables, refs: tuple[int, ...]) -> None:
        """`refs` are the variables at the atom's refs, in their order; one can stand at several."""
        self.variables = variables
        self.flat, self.binds = True, frozenset(variables)
        self.changes = []
        self.current = ABSENT
        places = [refs.index(v) for v in variables]
        self._pick = places
        self._repeated = [(i, refs.index(v)) for i, v in enumerate(refs) if refs.index(v) != i]

    def take(self, match: Match) -> None:
        """Move on to the next step."""
        key: Key | Absent
        if match is None or (self._repeated and any(match[i] != match[j] for i, j in self._repeated)):
            key = ABSENT
        elif len(self._pick) == 1:
            key = match[self._pick[0]]
        else:
            key = tuple([match[i] for i in self._pick])
        if key == self.current:
            self.changes = []
            return
        self.changes = [k for k in (self.current, key) if k is not ABSENT]
        self.current = key

    def snapshot(self) -> Any:
        """Where it holds, as plain data."""
        return [self.current] if self.holds else []

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        self.current = read_key(data[0]) if data else ABSENT

    def at(self, key: Key) -> bool:
        """Whether it holds at a key."""
        return bool(key == self.current)

    def points(self) -> Collection[Key]:
        """The key at which it holds."""
        return [self.current] if self.holds and self.variables else []

    def spread(self, region: Region, place: int) -> Collection[str]:
        """The text at the place, where it holds in the region."""
        if isinstance(self.current, Absent):
            return ()
        texts = texts_of(self.current)
        fits = all(r is ALL or r == t for r, t in zip(region, texts, strict=True))
        text = texts[place]
        return (text,) if fits and text is not None else ()

    def constant(self, region: Region) -> bool | None:
        """False where it holds nowhere in the region."""
        if isinstance(self.current, Absent):
            return False
        if ALL not in region:
            return self.at(key_of(region))
        fits = all(r is ALL or r == t for r, t in zip(region, texts_of(self.current), strict=True))
        return None if fits else False

    def index(self) -> None:
        """Nothing to prepare."""

    def apart(self, variable: int) -> Iterator[str]:
        """The text at which it holds."""
        return texts_at([] if isinstance(self.current, Absent) else [self.current], self.variables, variable)

    def settled(self, key: Key) -> None:
        """None: the next step may be any."""

    def can_settle(self, fresh: frozenset[int]) -> tuple[bool, bool]:  # noqa: ARG002
        """Neither."""
        return False, False
