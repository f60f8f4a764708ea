"""A spec made ready for judging: what each stream's messages show, and which atoms can hold there.

A plan is shared by all sessions of its spec; it holds no state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Protocol

from oracle_server.core.atoms import AtomTest, Match, specialise
from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.kinds import RESERVED
from oracle_server.core.signals import DefaultProjection, Projection
from oracle_server.core.spec import By, Property, Spec, StreamSpec
from oracle_server.core.stamps import DEFAULT_PATHS


class Projects(Protocol):
    """Computes a message's signals, and the names of those that failed."""

    @property
    def fields(self) -> frozenset[str] | None:
        """The dotted paths of the fields that are read, None for the whole message."""
        ...

    def __call__(self, message: object) -> tuple[dict[str, Scalar], frozenset[str]]:
        """The signals by name, and the names of those that failed."""
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
    indexes of the properties whose external oracles receive its events.
    """

    spec: StreamSpec
    project: Projects
    constants: Mapping[str, Scalar]
    views: tuple[View, ...]
    guards: tuple[int, ...]
    blames: tuple[int, ...]
    undoes: bool
    asked: tuple[int, ...] = ()

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
    guard or read a topic or service, by its name.
    """

    spec: Spec
    streams: Mapping[StreamKey, StreamPlan]
    silent: tuple[View, ...]
    timed: bool
    external: tuple[int, ...] = ()
    readers: Mapping[str, frozenset[int]] = field(default_factory=dict)


def plan(spec: Spec) -> Plan:
    """Make a spec ready. Raises `ExpressionError` where an expression of its signals can't be read."""
    formulas = tuple(p.atoms for p in spec.properties)
    held = frozenset[str]().union(*(s.hold for s in spec.streams))
    silent = tuple(_view(formula, {}, held.__contains__) for formula in formulas)
    timed = any(p.time == "seconds" for p in spec.properties)
    external = tuple(i for i, p in enumerate(spec.properties) if p.external is not None)
    streams = {s.key: _plan_stream(spec, s, formulas, held) for s in spec.streams}
    return Plan(spec, streams, silent, timed, external, _readers(spec, held))


def judged_by(ready: Plan, by: By | None) -> Plan:
    """A plan that judges in another order than its spec asks for, None for the same."""
    if by is None:
        return ready
    ordering = replace(ready.spec.ordering, by=by)
    return replace(ready, spec=replace(ready.spec, ordering=ordering))


def constants(stream: StreamSpec) -> dict[str, Scalar]:
    """The signals that every event of a stream has with the same value."""
    return {stream.traits.group: stream.name, "kind": stream.kind}


def can_meet(stream: StreamSpec, atom: Atom) -> bool:
    """Whether some event of a stream can meet an atom, as far as the reserved signals decide it."""
    reserved = [c for c in atom.constraints if c.key in RESERVED]
    if not reserved:  # as most have none, and each atom is looked at on each stream
        return True
    return bool(specialise([Atom(tuple(reserved))], constants(stream), lambda key: has_reserved(stream, key)))


def has_reserved(stream: StreamSpec, key: str) -> bool:
    """Whether every event of a stream has the reserved signal `key`."""
    return key in constants(stream) or key == "monitor" or (key == "call" and stream.traits.has_call)


def named_signals(stream: StreamSpec, formulas: tuple[tuple[Atom, ...], ...], held: frozenset[str]) -> frozenset[str]:
    """The signals that some atom reads of a stream, with neither the reserved ones nor those that others hold."""
    met = [atom for formula in formulas for atom in formula if can_meet(stream, atom)]
    named = frozenset(c.key for atom in met for c in atom.constraints) - RESERVED
    return named - ((named & held) - stream.hold)


def _readers(spec: Spec, held: frozenset[str]) -> dict[str, frozenset[int]]:
    readers: dict[str, frozenset[int]] = {}
    for stream in spec.streams:
        found = frozenset(i for i, p in enumerate(spec.properties) if _concerns(stream, p, held))
        readers[stream.name] = readers.get(stream.name, frozenset()) | found
    return readers


def _concerns(stream: StreamSpec, prop: Property, held: frozenset[str]) -> bool:
    """Whether a property guards a stream, or reads its events: by name, kind, or signals of their own."""
    if stream.name in prop.guards or (prop.external is not None and prop.external.receives(stream)):
        return True
    if any(c.key in stream.hold for atom in prop.atoms for c in atom.constraints):
        return True
    own = named_signals(stream, (prop.atoms,), held) if stream.signals is None else frozenset(stream.signals)
    read = [{c.key for c in atom.constraints} for atom in prop.atoms if can_meet(stream, atom)]
    return any(not keys or not keys.isdisjoint(own | RESERVED) for keys in read)


def _plan_stream(
    spec: Spec, stream: StreamSpec, formulas: tuple[tuple[Atom, ...], ...], held: frozenset[str]
) -> StreamPlan:
    project: Projects
    if stream.signals is None:
        names = named_signals(stream, formulas, held)
        project = DefaultProjection(sorted(names))
    else:
        names = frozenset(stream.signals)
        project = Projection(stream.signals)
    known = constants(stream)
    own = names | {key for key in RESERVED if has_reserved(stream, key)}
    views = [_view(formula_atoms, known, lambda key: key in own or key in held) for formula_atoms in formulas]
    asked = []
    for i, prop in enumerate(spec.properties):
        if prop.external is not None and prop.external.receives(stream):
            asked.append(i)
        elif prop.external is not None:
            views[i] = replace(views[i], observed=False)
    guards = tuple(i for i, p in enumerate(spec.properties) if stream.name in p.guards)
    blames = tuple(i for i in guards if spec.properties[i].blame == "caused")
    undoes = stream.on_deny == "undo" and stream.traits.undoable
    return StreamPlan(stream, project, known, tuple(views), guards, blames, undoes, tuple(asked))


def _view(formula_atoms: tuple[Atom, ...], known: Mapping[str, Scalar], possible: Callable[[str], bool]) -> View:
    tests = specialise(formula_atoms, known, possible)
    reads = frozenset().union(*(test.reads for test in tests)) - RESERVED
    return View(len(formula_atoms), tests, reads)
