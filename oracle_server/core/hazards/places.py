"""Where a formula is judged: at the events of each stream, and at ticks; and which atoms can hold there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import or_

from oracle_server.core.atoms import meets
from oracle_server.core.comparisons import Sign, contradictory, met, turned
from oracle_server.core.derived.definition import Definition, Op
from oracle_server.core.derived.lacking import lacking
from oracle_server.core.derived.ranges import derived_ranges, ranges_now
from oracle_server.core.expression import is_always_there
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Any, Atom, Constraint, Limit, Ref, Scalar, Signal
from oracle_server.core.hazards.withholding import present
from oracle_server.core.kinds import GOAL_ID, RESERVED, STATUS, STATUSES
from oracle_server.core.plan import constants, has_reserved, not_signals, reserved_of
from oracle_server.core.ranges import ANYTHING, NUMBER, TEXT, Range, range_of, range_of_field
from oracle_server.core.shapes import Record, Value
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.typed import StreamTypes, TypedMessage

_LISTED = 3
"""Places that a message names."""
_RESERVED: Mapping[str, Range] = {"monitor": TEXT, "call": NUMBER}
_MARKS: Mapping[str, Range] = {GOAL_ID: TEXT, STATUS: Range(values=STATUSES)}
_NOTHING = Record("", {})
_ITSELF: Mapping[Op, tuple[Sign, ...]] = {"last": (0,), "max": (-1, 0), "min": (0, 1)}
"""How a signal compares with what is derived of it by these, where it is among the samples itself."""


@dataclass(frozen=True, slots=True)
class Place:
    """The events of a stream, None for ticks, of which one carries a key: what signals they can have.

    `constants` are those that every event has with the same value, `always` those that it has with some value, unless
    they failed; `own` has the values that the stream's other signals can have, and `held`, which all places share,
    those of signals that keep their values and of derived ones, but for those that are always absent here, which `lack`
    other signals; `counted` are the ages and counts, each with its values where its own formula holds; `open`: a signal
    of any name may be there.
    """

    stream: StreamSpec | None
    constants: Mapping[str, Scalar]
    always: frozenset[str]
    own: Mapping[str, Range]
    held: Mapping[str, Range]
    open: bool
    lack: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    counted: Mapping[str, tuple[Definition, Range]] = field(default_factory=dict)
    again: Mapping[str, Definition] = field(default_factory=dict)
    _now: dict[str, Range | None] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """What people call it."""
        return str(self.stream.key) if self.stream else "a deadline"

    def has(self, key: str) -> bool:
        """Whether an event can have a signal."""
        if self._reserves(key):
            return key in self.own if self.stream is None else has_reserved(self.stream, key)
        if key in self.own or (self.open and not (self.stream and key in not_signals(self.stream))):
            return True
        return key in self.held and key not in self.lack

    def among(self, keys: frozenset[str]) -> frozenset[str]:
        """Those of some signals that an event can have."""
        reserved = RESERVED if self.stream is None else reserved_of(self.stream)
        near = keys if self.open else keys & (self.own.keys() | self.held.keys() | reserved)
        return frozenset(filter(self.has, near))

    def allows(self, atom: Atom) -> bool:
        """Whether an event can meet an atom, as far as the reserved signals decide."""
        reserved = [c for c in atom.constraints if self._reserves(c.key)]
        return all(self.has(c.key) and (c.key not in self.constants or self._constant(c)) for c in reserved)

    def lacks(self, atom: Atom) -> list[str]:
        """The signals that an atom needs, and no event has here."""
        return [key for key in dict.fromkeys(c.key for c in atom.constraints) if not self.has(key)]

    def misfit(self, atom: Atom) -> list[Constraint]:
        """Constraints on one signal that no value which it can have meets; empty where there are none."""
        by_key: dict[str, list[Constraint]] = {}
        for constraint in atom.constraints:
            by_key.setdefault(constraint.key, []).append(constraint)
            if isinstance(constraint.value, Signal):
                by_key.setdefault(constraint.value.name, []).append(turned(constraint))
        for key, own in by_key.items():
            if key not in self.constants and not self.range(key).meets(own):
                return own
        return []

    def range(self, key: str) -> Range:
        """The values that a signal can have."""
        if key in self.constants:
            return Range(values=(self.constants[key],))
        return _RESERVED.get(key) or self.own.get(key) or self.now(key) or self.held.get(key) or ANYTHING

    def now(self, key: str) -> Range | None:
        """The values of an age or count where its own formula holds at every event here; None elsewhere."""
        if key in self.counted and key not in self._now:
            definition, values = self.counted[key]
            holds = definition.formula is not None and present(definition.formula, self.value) is True
            self._now[key] = values if holds else None
        return self._now.get(key)

    def is_there(self, key: str) -> bool:
        """Whether every event has a signal, unless it failed."""
        return key in self.always or (self.now(key) is not None and self.always.issuperset(self.counted[key][0].by))

    def signs(self, key: str, other: str) -> tuple[Sign, ...] | None:
        """How a signal compares with what is derived of it and counts it, None for two others."""
        found = self.again.get(other)
        return _ITSELF[found.op] if found is not None and found.of == key else None

    def itself(self, constraint: Constraint) -> bool | None:
        """What a comparison of a signal with the last, least or largest of its samples, this one among them, comes to.

        None where it may be either, and for all other constraints.
        """
        for asked in (constraint, turned(constraint)) if isinstance(constraint.value, Signal) else ():
            signs = self.signs(asked.key, asked.value.name) if isinstance(asked.value, Signal) else None
            answers = {met(asked, sign) for sign in signs or ()}
            if len(answers) == 1:
                return answers.pop()
        return None

    def value(self, atom: Atom) -> bool | None:
        """Whether an atom holds at every event (true), at none (false), or that is not known."""
        if not self.allows(atom) or self.lacks(atom) or self.misfit(atom) or contradictory(atom.constraints):
            return False
        if any(self.itself(c) is False for c in atom.constraints):
            return False
        return True if all(self.sure(c) for c in atom.constraints) else None

    def sure(self, constraint: Constraint) -> bool:
        """Whether every event meets a constraint, on a signal that it allows."""
        key, wanted = constraint.key, constraint.value
        if isinstance(wanted, Ref | Signal | Limit):
            return False
        if key in self.constants or (wanted is Any.ANY and self.is_there(key)):
            return True
        return self.is_there(key) and self.range(key).always_meets(constraint)

    def looks(self, keys: Sequence[str]) -> tuple[object, ...]:
        """All that decides what is known here of an atom with these keys: equal for places that are alike to it."""
        return tuple(
            (self.constants.get(key), self.has(key))
            if self._reserves(key)
            else self.has(key) and (id(self.range(key)), self.is_there(key), key in self.again)
            for key in keys
        )

    def _reserves(self, key: str) -> bool:
        """Whether a name in an atom is no signal of a message here."""
        return key in (RESERVED if self.stream is None else reserved_of(self.stream))

    def _constant(self, constraint: Constraint) -> bool:
        return meets(constraint, self.constants[constraint.key])


def places(spec: Spec, time: Time, types: StreamTypes | None = None) -> list[Place]:
    """Where the properties of a time are judged. The expressions of the spec's signals must be sound."""
    ranges = _Ranges()
    holding = spec.kept
    owns = [_own(stream, (types or {}).get(stream.key), holding, ranges) for stream in spec.streams]
    streams = list(zip(spec.streams, owns, strict=True))
    held = {name: own.get(name, ANYTHING) for stream, (own, _) in streams for name in stream.hold}
    derived = derived_ranges(spec, _all(spec, owns, types or {})) if spec.derive else {}
    held |= {definition.name: ranges.same(derived[definition.name]) for definition in spec.derive}
    found = []
    for stream, (own, always) in streams:
        either = {key: ranges.same(one | held[key]) if key in held else one for key, one in own.items()}
        known = stream.signals is not None or stream.key in (types or {})
        marks = {key: _MARKS[key] for key in stream.traits.marks}
        there = always | {"monitor"} | marks.keys()
        found.append(Place(stream, constants(stream), there, either | marks, held, open=not known))
    if time == "seconds":
        carried = {by: ranges.same(_anywhere(by, found)) for d in spec.derive for by in d.by}
        found.append(Place(None, {}, frozenset(), carried, held, open=False))
    return _with_lacks(spec, found) if spec.derive else found


def _anywhere(key: str, found: Sequence[Place]) -> Range:
    """The values of a signal at the events that can have it."""
    return reduce(or_, (place.range(key) for place in found if place.has(key)), Range())


def _all(
    spec: Spec, owns: Sequence[tuple[Mapping[str, Range], frozenset[str]]], types: StreamTypes
) -> dict[str, Range] | None:
    """The values of all signals of messages, None where a message may have others, too."""
    if any(stream.signals is None and stream.key not in types for stream in spec.streams):
        return None
    found: dict[str, Range] = {}
    for own, _ in owns:
        for name, values in own.items():
            found[name] = found.get(name, Range()) | values
    return found


def _with_lacks(spec: Spec, found: Sequence[Place]) -> list[Place]:
    """The places with the derived signals that are absent there, worked out once for all that have the same of them.

    A tick carries the keys that it is for.
    """
    needed = frozenset(name for definition in spec.derive for name in definition.needed)
    keys = frozenset(by for definition in spec.derive for by in definition.by)
    lacks: dict[frozenset[str], Mapping[str, tuple[str, ...]]] = {}
    made, counted = [], ranges_now(spec)
    derived = {definition.name for definition in spec.derive}
    counting = [d for d in spec.derive if d.op in _ITSELF and d.of not in derived]
    for place in found:
        there = place.among(needed) | (keys if place.stream is None else frozenset())
        if there not in lacks:
            lacks[there] = lacking(spec.derive, there.__contains__)
        again = {d.name: d for d in counting if _is_sample(d, place, found)}
        made.append(replace(place, lack=lacks[there], counted={} if place.stream is None else counted, again=again))
    return made


def _is_sample(definition: Definition, place: Place, found: Sequence[Place]) -> bool:
    """Whether a signal is a sample of what is derived of it wherever an event has it here, or still is the last one."""
    of = definition.of
    if of not in place.held or (place.stream is not None and of in place.stream.hold):
        return place.has(of)
    having = [other for other in found if other.stream and (of in other.own or other.open)]
    return len(having) == 1 and definition.op == "last" and not definition.by


def likened(atom: Atom, found: Sequence[Place]) -> list[Place]:
    """For each place the first one that is alike to an atom: of thousands of streams, few are not."""
    keys = tuple(dict.fromkeys(c.key for c in atom.constraints))
    first: dict[tuple[object, ...], Place] = {}
    return [first.setdefault(place.looks(keys), place) for place in found]


class _Ranges:
    """The ranges of expressions, and one object for all ranges that are equal."""

    def __init__(self) -> None:
        self._texts: dict[tuple[str, str, str], tuple[Range, bool]] = {}
        self._same: dict[object, Range] = {}

    def same(self, found: Range) -> Range:
        """The object for this range."""
        return self._same.setdefault(found.identity, found)

    def of(self, text: str, stream: StreamSpec, shape: Record | None) -> tuple[Range, bool]:
        """The range of a signal's expression, and whether each event has the signal; once a type."""
        key = (text, stream.each or "", "" if shape is None else f"{stream.type} {stream.kind}")
        if key not in self._texts:
            always = shape is not None and is_always_there(stream.read(text), shape)
            self._texts[key] = (self.same(range_of(text, shape, stream.each)), always)
        return self._texts[key]


def _own(
    stream: StreamSpec, known: TypedMessage | None, holding: frozenset[str], ranges: _Ranges
) -> tuple[dict[str, Range], frozenset[str]]:
    """The signals that are computed from a stream's messages, with their values, and which of them all events have."""
    if stream.signals is not None:
        shape = known.surest if known else None
        found = {name: ranges.of(text, stream, shape) for name, text in stream.signals.items()}
        return {name: own for name, (own, _) in found.items()}, frozenset(n for n, (_, there) in found.items() if there)
    fields = known.widest.fields if known else {}
    sure = known.surest if known else _NOTHING
    own, always = {}, set()
    for name, shape_there in fields.items():
        if (
            isinstance(shape_there, Value)
            and name not in not_signals(stream)
            and (name in stream.hold or name not in holding)
        ):
            value = sure.fields.get(name)
            own[name] = ranges.same(range_of_field(value if isinstance(value, Value) else None))
            if isinstance(value, Value) and value.kind != "bytes":
                always.add(name)
    return own, frozenset(always)


def names_of(found: Sequence[Place], last: str = "and") -> str:
    """Places in words, the first few of them."""
    names = list(dict.fromkeys(p.name for p in found))
    if len(names) > _LISTED:
        return f"{', '.join(names[:_LISTED])} {last} {len(names) - _LISTED} more"
    return f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1])))
