"""A spec made ready for judging: what each stream's messages show, and which atoms can hold there.

A plan is shared by all sessions of its spec; it holds no state.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

from oracle_server.core.atoms import AtomTest, Match, specialise
from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import Atom, Scalar
from oracle_server.core.kinds import RESERVED
from oracle_server.core.signals import DefaultProjection, Projection
from oracle_server.core.spec import By, Spec, StreamSpec


class Projects(Protocol):
    """Computes a message's signals, and the names of those that failed."""

    @property
    def fields(self) -> frozenset[str] | None:
        """The dotted paths of the fields that are read, None for the whole message."""
        ...

    def __call__(self, message: object) -> tuple[dict[str, Scalar], frozenset[str]]:
        """The signals by name, and the names of those that failed."""
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
        return None if self.asked else self.project.fields


@dataclass(frozen=True, slots=True)
class Plan:
    """A spec made ready, stream by stream.

    `silent` are the properties' views of a step that has no signals but held ones; `timed`: some property has
    `time: seconds`; `external` are the indexes of the properties that external oracles judge.
    """

    spec: Spec
    streams: Mapping[StreamKey, StreamPlan]
    silent: tuple[View, ...]
    timed: bool
    external: tuple[int, ...] = ()


def plan(spec: Spec) -> Plan:
    """Make a spec ready. Raises `ExpressionError` where an expression of its signals can't be read."""
    formulas = tuple(p.atoms for p in spec.properties)
    held = frozenset[str]().union(*(s.hold for s in spec.streams))
    silent = tuple(_view(formula, {}, held.__contains__) for formula in formulas)
    timed = any(p.time == "seconds" for p in spec.properties)
    external = tuple(i for i, p in enumerate(spec.properties) if p.external is not None)
    return Plan(spec, {s.key: _plan_stream(spec, s, formulas) for s in spec.streams}, silent, timed, external)


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
    return bool(specialise([atom], constants(stream), lambda key: key not in RESERVED or has_reserved(stream, key)))


def has_reserved(stream: StreamSpec, key: str) -> bool:
    """Whether every event of a stream has the reserved signal `key`."""
    return key in constants(stream) or key == "monitor" or (key == "call" and stream.traits.has_call)


def named_signals(stream: StreamSpec, formulas: tuple[tuple[Atom, ...], ...], held: frozenset[str]) -> frozenset[str]:
    """The signals that some atom reads of a stream, with neither the reserved ones nor those that others hold."""
    met = [atom for formula in formulas for atom in formula if can_meet(stream, atom)]
    return frozenset(c.key for atom in met for c in atom.constraints) - RESERVED - (held - stream.hold)


def _plan_stream(spec: Spec, stream: StreamSpec, formulas: tuple[tuple[Atom, ...], ...]) -> StreamPlan:
    held = frozenset().union(*(s.hold for s in spec.streams))
    project: Projects
    if stream.signals is None:
        names = named_signals(stream, formulas, held)
        project = DefaultProjection(sorted(names))
    else:
        names = frozenset(stream.signals)
        project = Projection(stream.signals)
    known = constants(stream)
    possible = names | held | {key for key in RESERVED if has_reserved(stream, key)}
    views = [_view(formula_atoms, known, possible.__contains__) for formula_atoms in formulas]
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
