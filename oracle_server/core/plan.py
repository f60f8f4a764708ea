"""A spec made ready for judging: what each stream's messages show, and which atoms can hold there.

A plan is shared by all sessions of its spec; it holds no state.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field, replace
from typing import Protocol

from oracle_server.core.atoms import AtomTest, Match, specialise, specialise_some
from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.layout import Layout, Part, parts, watched
from oracle_server.core.events import TICKS, By, Projected, StreamKey
from oracle_server.core.formula.ahead import looks_ahead
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.kinds import GROUPS, KINDS, OWN, RESERVED, Kind
from oracle_server.core.reach import Reach
from oracle_server.core.signals import DefaultProjection, Projection, RowProjection
from oracle_server.core.spec import Spec, StreamSpec
from oracle_server.core.stamps import DEFAULT_PATHS

_Keys = frozenset[str]


class Projects(Protocol):
    """Computes a message's signals, and the names of those that failed."""

    @property
    def fields(self) -> frozenset[str] | None:
        """The dotted paths of the fields that are read, None for the whole message."""
        ...

    def __call__(self, message: object) -> Projected:
        """The signals by name, and the names of those that failed."""
        ...

    def rows(self, message: object) -> Sequence[Projected]:
        """The same of each element that is a step of its own; empty where the message is one itself."""
        ...

    def reasons(self, message: object) -> dict[str, str]:
        """Why each signal failed that did, in a few words."""
        ...


@dataclass(frozen=True, slots=True)
class View:
    """What one property sees of one stream: the atoms to test, and the signals whose failure makes it unknown.

    `size` is the number of the formula's atoms, most of which can't hold on any one stream; `observed`: the property
    judges the stream's events at all; an external oracle may receive only some streams.
    """

    size: int
    tests: tuple[AtomTest, ...]
    reads: frozenset[str]
    observed: bool = True

    def matches(self, signals: Mapping[str, Scalar]) -> list[Match]:
        """The match of each of the formula's atoms at a step."""
        found: list[Match] = [None] * self.size
        for test in self.tests:
            found[test.index] = test.match(signals)
        return found


@dataclass(frozen=True, slots=True)
class StreamPlan:
    """One stream made ready; `views` has an entry for each property, `guards` the indexes of those that guard it.

    `blames` are those of the guards with `blame: caused`; `undoes`: a denied event is taken back; `asked` are the
    indexes of the properties whose external oracles receive its events; `derives` are the derived signals that it
    concerns.
    """

    spec: StreamSpec
    project: Projects
    constants: Mapping[str, Scalar]
    views: tuple[View, ...]
    guards: tuple[int, ...]
    blames: tuple[int, ...]
    undoes: bool
    asked: tuple[int, ...] = ()
    derives: tuple[Part, ...] = ()

    @property
    def fields(self) -> frozenset[str] | None:
        """The dotted paths of the fields that are needed of a message, None for all of them."""
        read, stamp = self.project.fields, self.spec.stamp
        if self.asked or read is None:
            return None
        return read if stamp is None or stamp.plain else read | {stamp.field}

    @property
    def decoded(self) -> frozenset[str] | None:
        """The same with the fields of a publication time, which is read where the monitor tells none."""
        stamp, needed = self.spec.stamp, self.fields
        return None if needed is None else needed.union(DEFAULT_PATHS if stamp is None else [stamp.field])

    @property
    def named(self) -> frozenset[str]:
        """The dotted paths of the fields that the spec's expressions name, and of a stamp that the server reads."""
        stamp = self.spec.stamp
        declared = self.project.fields if self.spec.signals is not None else None
        return (declared or frozenset()) | (frozenset([stamp.field]) if stamp and not stamp.plain else frozenset())


@dataclass(frozen=True, slots=True)
class Plan:
    """A spec made ready, stream by stream.

    `silent` are the properties' views of a step that has no signals but held ones; `timed`: some property has
    `time: seconds`; `external` are the indexes of the properties that external oracles judge; `readers` are those that
    guard or read a topic or service, by its name; `derived` is None where the spec derives no signals. `unread` are the
    derived signals that the steps of a stream, and ticks, do not have, since no formula reads them there.
    """

    spec: Spec
    streams: Mapping[StreamKey, StreamPlan]
    silent: tuple[View, ...]
    timed: bool
    external: tuple[int, ...] = ()
    readers: Mapping[str, frozenset[int]] = field(default_factory=dict)
    derived: Layout | None = None
    unread: Mapping[StreamKey, frozenset[str]] = field(default_factory=dict)


def plan(spec: Spec) -> Plan:
    """Make a spec ready. Raises `ExpressionError` where an expression of its signals can't be read."""
    making = _Making(spec)
    silent = making.silent()
    timed = any(p.time == "seconds" for p in spec.properties)
    external = tuple(i for i, p in enumerate(spec.properties) if p.external is not None)
    streams = {s.key: making.stream(s) for s in spec.streams}
    derived = making.derived(silent)
    read = {key: stream.derives for key, stream in streams.items()} | {TICKS: () if derived is None else derived.silent}
    unread = {key: _unread(spec.derive, found) for key, found in read.items()}
    return Plan(spec, streams, silent, timed, external, making.readers(), derived, unread)


def _unread(definitions: Sequence[Definition], found: Sequence[Part]) -> frozenset[str]:
    """The derived signals that have no value where these parts of them are."""
    return frozenset(d.name for d in definitions) - {definitions[part.index].name for part in found if part.wanted}


def judged_by(ready: Plan, by: By | None) -> Plan:
    """A plan that judges in another order than its spec asks for, None for the same; only by publication it revises."""
    if by is None:
        return ready
    ordering = replace(ready.spec.ordering, by=by)
    if by != "publication" and ordering.late == "revise":
        ordering = replace(ordering, late="judge")
    return replace(ready, spec=replace(ready.spec, ordering=ordering))


def constants(stream: StreamSpec) -> dict[str, Scalar]:
    """The signals that every event of a stream has with the same value."""
    return {stream.traits.group: stream.name, "kind": stream.kind}


def can_meet(stream: StreamSpec, atom: Atom) -> bool:
    """Whether some event of a stream can meet an atom, as far as the reserved signals decide it."""
    names = reserved_of(stream)
    reserved = [c for c in atom.constraints if c.key in names]
    if not reserved:  # as most have none, and each atom is looked at on each stream
        return True
    return bool(specialise([Atom(tuple(reserved))], constants(stream), lambda key: has_reserved(stream, key)))


def has_reserved(stream: StreamSpec, key: str) -> bool:
    """Whether every event of a stream has the reserved signal `key`."""
    traits = stream.traits
    return key in (traits.group, "kind", "monitor", *traits.marks) or (key == "call" and traits.has_call)


def reserved_of(stream: StreamSpec) -> frozenset[str]:
    """The names that are no signals of a stream's messages, where an atom reads them of it.

    Those of an action are ordinary ones elsewhere, but for its own, where the stream does not declare that.
    """
    names = _RESERVED[stream.kind]
    return names if not stream.signals or names.isdisjoint(stream.signals) else names - stream.signals.keys()


def not_signals(stream: StreamSpec) -> frozenset[str]:
    """The names of which a stream without `signals` has none, whatever its messages have."""
    return reserved_of(stream) | OWN[stream.traits.group]


_RESERVED = {kind: RESERVED.union(GROUPS, traits.marks) for kind, traits in KINDS.items() if traits.group}


def naming(spec: Spec) -> frozenset[str]:
    """The keys that name interfaces in a spec's atoms: no group's where some stream has a signal of that name."""
    return frozenset(GROUPS).difference(*(stream.signals or () for stream in spec.streams))


def named_signals(stream: StreamSpec, formulas: tuple[tuple[Atom, ...], ...], held: frozenset[str]) -> frozenset[str]:
    """The signals that some atom reads of a stream, with neither the reserved ones nor those that others hold."""
    met = [atom for formula in formulas for atom in formula if can_meet(stream, atom)]
    named = frozenset(c.key for atom in met for c in atom.constraints) - not_signals(stream)
    return named - ((named & held) - stream.hold)


class _Making:
    """A plan in the making: what is the same for many streams is computed once."""

    def __init__(self, spec: Spec) -> None:
        self._count = len(spec.properties)
        self.formulas = spec.readings
        """The atoms of the properties, and behind them what derived signals read."""
        self.held = spec.kept
        self._spec, self._reach = spec, Reach(self.formulas, naming(spec))
        self._views: dict[object, list[View]] = {}
        self._keys: dict[Kind, list[frozenset[_Keys]]] = {}
        self._reading: dict[object, frozenset[int]] = {}

    def stream(self, stream: StreamSpec) -> StreamPlan:
        """One stream made ready."""
        project: Projects
        if stream.signals is None:
            names = self._names(stream)
            project = DefaultProjection(sorted(names))
        else:
            names = frozenset(stream.signals)
            project = RowProjection(stream.signals, stream.each) if stream.each else Projection(stream.signals)
        reserved = {key for key in reserved_of(stream) if has_reserved(stream, key)}
        views, derives = self._divided(self._views_of(stream, names | reserved), names, reserved)
        asked, properties = [], self._spec.properties
        for i, prop in enumerate(properties):
            if prop.external is not None and prop.external.receives(stream):
                asked.append(i)
            elif prop.external is not None:
                views[i] = replace(views[i], observed=False)
        guards = tuple(i for i, p in enumerate(properties) if stream.name in p.guards)
        blames = tuple(i for i in guards if properties[i].blame == "caused")
        undoes = stream.on_deny == "undo" and stream.traits.undoable
        return StreamPlan(
            stream, project, constants(stream), tuple(views), guards, blames, undoes, tuple(asked), derives
        )

    def silent(self) -> tuple[View, ...]:
        """The properties' views of a step without signals but held and derived ones, and those that it is for."""
        keys = {by for d in self._spec.derive for by in d.by}
        possible = {*self.held, *keys}
        formulas = self.formulas[: self._count]
        return tuple(_view(len(atoms), specialise(atoms, {}, possible.__contains__)) for atoms in formulas)

    def derived(self, silent: Sequence[View]) -> Layout | None:
        """What the derived signals are at ticks, where properties have these views."""
        derive, properties = self._spec.derive, self._spec.properties
        if not derive:
            return None
        read = frozenset[str]().union(*(view.reads for view in silent))
        timed = [
            (i, [prop.atoms[test.index] for test in view.tests])
            for i, (prop, view) in enumerate(zip(properties, silent, strict=True))
            if prop.time == "seconds" and not looks_ahead(prop.formula)  # operands of that are judged at steps alone
        ]
        at_ticks = parts(derive, [()] * len(derive), (), (), read)
        return Layout(derive, at_ticks, watched(derive, timed), frozenset(by for d in derive for by in d.by))

    def _divided(
        self, views: list[View], own: _Keys, reserved: AbstractSet[str]
    ) -> tuple[list[View], tuple[Part, ...]]:
        """The properties' views of a stream, and the derived signals that concern it."""
        of_properties, of_derived = views[: self._count], views[self._count :]
        if not of_derived:
            return of_properties, ()
        read = frozenset[str]().union(*(view.reads for view in of_properties))
        return of_properties, parts(self._spec.derive, [v.tests for v in of_derived], own, reserved, read)

    def readers(self) -> dict[str, frozenset[int]]:
        """The properties that guard or read each topic or service, by its name."""
        readers: dict[str, frozenset[int]] = {}
        through = self._through_derived()
        for stream in self._spec.streams:
            found = self._concerned(stream)
            known = found.union(*(through[i] for i in found if i >= self._count)) if through else found
            properties = frozenset(i for i in known if i < self._count)
            readers[stream.name] = readers.get(stream.name, frozenset()) | properties
        return readers

    def _through_derived(self) -> dict[int, frozenset[int]]:
        """For each derived signal, by its place among all formulas, the properties that read it, or what reads it."""
        found: dict[int, frozenset[int]] = {}
        names = {d.name: self._count + i for i, d in enumerate(self._spec.derive)}
        for name, place in reversed(names.items()):
            direct = [i for i, atoms in enumerate(self.formulas) if any(name in _keys(atom) for atom in atoms)]
            found[place] = frozenset(direct).union(*(found[i] for i in direct if i >= self._count))
        return found

    def _views_of(self, stream: StreamSpec, own: frozenset[str]) -> list[View]:
        """The properties' views of a stream with these signals."""
        known = constants(stream)

        def possible(key: str) -> bool:
            return key in own or key in self.held

        alike = stream.kind, own
        if alike not in self._views:
            tests = [specialise_some(atoms, known, possible) for atoms in self._reach.free]
            self._views[alike] = [_view(len(atoms), found) for atoms, found in zip(self.formulas, tests, strict=True)]
        views = self._views[alike].copy()
        more: defaultdict[int, list[AtomTest]] = defaultdict(list)
        for i, atom in self._reach.naming(stream):
            more[i] += specialise_some([atom], known, possible)
        for i, tests_here in more.items():
            views[i] = _view(views[i].size, (*views[i].tests, *tests_here))
        return views

    def _names(self, stream: StreamSpec) -> _Keys:
        """The signals of a stream that declares none."""
        named = frozenset[str]().union(*(keys for found in self._met(stream.kind) for keys in found))
        named |= {key for _, keys in self._met_by_name(stream) for key in keys}
        return named - not_signals(stream) - ((named & self.held) - stream.hold)

    def _met(self, kind: Kind) -> list[frozenset[_Keys]]:
        """For each property, the signals of each atom that names nothing and that events of a kind can meet."""
        if kind not in self._keys:
            nameless = StreamSpec("", kind)
            free = self._reach.free
            self._keys[kind] = [frozenset(_keys(a) for _, a in atoms if can_meet(nameless, a)) for atoms in free]
        return self._keys[kind]

    def _met_by_name(self, stream: StreamSpec) -> Iterator[tuple[int, _Keys]]:
        """The signals of the other atoms that a stream's events can meet, each with its property."""
        return ((i, _keys(atom)) for i, (_, atom) in self._reach.naming(stream) if can_meet(stream, atom))

    def _concerned(self, stream: StreamSpec) -> frozenset[int]:
        """The properties that guard a stream, or read its events: by name, kind, or signals of their own."""
        reserved = reserved_of(stream)
        own = None if stream.signals is None else frozenset(stream.signals) | reserved
        others = self.held - stream.hold

        def reads(keys: _Keys) -> bool:
            if own is not None:
                return not keys.isdisjoint(own)
            return not keys <= others or not keys.isdisjoint(reserved)

        alike = stream.kind, own, stream.hold
        if alike not in self._reading:
            found = {i for i, seen in enumerate(self._met(stream.kind)) if any(map(reads, seen))}
            if stream.hold:
                found |= {i for i, a in enumerate(self.formulas) if any(_keys(x) & stream.hold for x in a)}
            self._reading[alike] = frozenset(found)
        named = {i for i, keys in self._met_by_name(stream) if reads(keys)}
        given = {
            i
            for i, p in enumerate(self._spec.properties)
            if stream.name in p.guards or (p.external is not None and p.external.receives(stream))
        }
        return self._reading[alike] | named | given


def _keys(atom: Atom) -> _Keys:
    return frozenset(c.key for c in atom.constraints)


def _view(size: int, tests: tuple[AtomTest, ...]) -> View:
    reads = frozenset[str]().union(*(test.reads for test in tests)) - RESERVED
    return View(size, tests, reads)
