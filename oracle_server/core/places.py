"""Where a formula is judged: at the events of each stream, and at ticks; and which atoms can hold there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from oracle_server.core.atoms import meets
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Any, Atom, Constraint, Scalar
from oracle_server.core.kinds import RESERVED
from oracle_server.core.plan import constants, has_reserved
from oracle_server.core.ranges import ANYTHING, Range, range_of
from oracle_server.core.spec import Spec, StreamSpec

_LISTED = 3
"""Places that a message names."""


@dataclass(frozen=True, slots=True)
class Place:
    """The events of a stream, None for ticks: what signals they can have.

    `constants` are those that every event has with the same value, `always` those that it has with some value;
    `own` has the values that the stream's other signals can have, and `held`, which all places share, those of signals
    that keep their values; `open`: a signal of any name may be there.
    """

    stream: StreamSpec | None
    constants: Mapping[str, Scalar]
    always: frozenset[str]
    own: Mapping[str, Range]
    held: Mapping[str, Range]
    open: bool

    @property
    def name(self) -> str:
        """What people call it."""
        return str(self.stream.key) if self.stream else "a deadline"

    def has(self, key: str) -> bool:
        """Whether an event can have a signal."""
        if key in RESERVED:
            return self.stream is not None and has_reserved(self.stream, key)
        return self.open or key in self.own or key in self.held

    def allows(self, atom: Atom) -> bool:
        """Whether an event can meet an atom, as far as the reserved signals decide."""
        reserved = [c for c in atom.constraints if c.key in RESERVED]
        return all(self.has(c.key) and (c.key not in self.constants or self._constant(c)) for c in reserved)

    def lacks(self, atom: Atom) -> list[str]:
        """The signals that an atom needs, and no event has here."""
        return [key for key in dict.fromkeys(c.key for c in atom.constraints) if not self.has(key)]

    def misfit(self, atom: Atom) -> list[Constraint]:
        """Constraints on one signal that no value which it can have meets; empty where there are none."""
        by_key: dict[str, list[Constraint]] = {}
        for constraint in atom.constraints:
            by_key.setdefault(constraint.key, []).append(constraint)
        for key, own in by_key.items():
            if key not in self.constants and not self.range(key).meets(own):
                return own
        return []

    def range(self, key: str) -> Range:
        """The values that a signal can have."""
        return self.own.get(key) or self.held.get(key) or ANYTHING

    def value(self, atom: Atom) -> bool | None:
        """Whether an atom holds at every event (true), at none (false), or that is not known."""
        if not self.allows(atom) or self.lacks(atom) or self.misfit(atom):
            return False
        sure = all(c.key in self.constants or (c.key in self.always and c.value is Any.ANY) for c in atom.constraints)
        return True if sure else None

    def looks(self, keys: Sequence[str]) -> tuple[object, ...]:
        """All that decides what is known here of an atom with these keys: equal for places that are alike to it."""
        return tuple(
            (self.constants.get(key), self.has(key)) if key in RESERVED else self.has(key) and id(self.range(key))
            for key in keys
        )

    def _constant(self, constraint: Constraint) -> bool:
        return meets(constraint, self.constants[constraint.key])


def places(spec: Spec, time: Time) -> list[Place]:
    """Where the properties of a time are judged. The expressions of the spec's signals must be sound."""
    ranges = _Ranges()
    owns = [{name: ranges[text] for name, text in (stream.signals or {}).items()} for stream in spec.streams]
    held = {
        name: own.get(name, ANYTHING) for stream, own in zip(spec.streams, owns, strict=True) for name in stream.hold
    }
    found = [_place(stream, own, held) for stream, own in zip(spec.streams, owns, strict=True)]
    if time == "seconds":
        found.append(Place(None, {}, frozenset(), {}, held, open=False))
    return found


def likened(atom: Atom, found: Sequence[Place]) -> list[Place]:
    """For each place the first one that is alike to an atom: of thousands of streams, few are not."""
    keys = tuple(dict.fromkeys(c.key for c in atom.constraints))
    first: dict[tuple[object, ...], Place] = {}
    return [first.setdefault(place.looks(keys), place) for place in found]


class _Ranges(dict[str, Range]):
    """The range of each expression: one object for all streams that have it."""

    def __missing__(self, text: str) -> Range:
        self[text] = found = range_of(text)
        return found


def _place(stream: StreamSpec, own: Mapping[str, Range], held: Mapping[str, Range]) -> Place:
    ranges = {key: found | held[key] if key in held else found for key, found in own.items()}
    return Place(stream, constants(stream), frozenset({"monitor"}), ranges, held, open=stream.signals is None)


def names_of(found: Sequence[Place], last: str = "and") -> str:
    """Places in words, the first few of them."""
    names = list(dict.fromkeys(p.name for p in found))
    if len(names) > _LISTED:
        return f"{', '.join(names[:_LISTED])} {last} {len(names) - _LISTED} more"
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1])))
