"""Which derived signals concern which streams: where they have samples, and where something reads them.

What is worked out once for all sessions of a spec; a stream that concerns none of them costs nothing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from oracle_server.core.atoms import AtomTest
from oracle_server.core.comparisons import turned
from oracle_server.core.derived.definition import OPS, Definition
from oracle_server.core.derived.samples import (
    Sampler,
    sample_of,
    sample_of_any,
    sample_of_derived,
    sample_of_events,
    sample_of_formula,
    sample_of_reserved,
    sample_of_value,
)
from oracle_server.core.formula.tree import Atom, Constraint, Signal


@dataclass(frozen=True, slots=True)
class Part:
    """A derived signal on one stream: its place among all, how a step gives a sample, and whether its value is read.

    `own` is the signal of the stream that is its sample wherever it is a number, empty where there is none.
    """

    index: int
    sample: Sampler | None
    wanted: bool
    own: str = ""


@dataclass(frozen=True, slots=True)
class Watched:
    """A derived signal that time alone changes: what is asked of it at ticks, each by which properties.

    `compares`: some of that compares it with another signal. Of these, `abreast` are ages beside its own, from which it
    stays as far, and `moving` all others that time changes.
    """

    index: int
    asked: tuple[Constraint, ...]
    properties: tuple[frozenset[int], ...]
    abreast: frozenset[str] = frozenset()
    moving: frozenset[str] = frozenset()
    compares: bool = False


@dataclass(frozen=True, slots=True)
class Layout:
    """The derived signals of a spec, in order; `silent` are those that are read at ticks."""

    definitions: tuple[Definition, ...]
    silent: tuple[Part, ...] = ()
    watched: tuple[Watched, ...] = ()
    keys: frozenset[str] = field(default=frozenset())
    """The signals by which some are kept."""


def parts(
    definitions: Sequence[Definition],
    tests: Sequence[Sequence[AtomTest]],
    own: Collection[str],
    reserved: Collection[str],
    read: Collection[str],
) -> tuple[Part, ...]:
    """What concerns a stream that has these signals `own` and `reserved`, and of which formulas `read` some.

    `tests` has an entry for each definition: what is left to test there of its atoms.
    """
    samplers: dict[str, Sampler] = {}
    for definition, left in zip(definitions, tests, strict=True):
        sample = _sampler(definition, left, own, reserved, samplers)
        if sample is not None:
            samplers[definition.name] = sample
    wanted = set(read)
    found = []
    for index, definition in reversed(list(enumerate(definitions))):
        sample, is_read = samplers.get(definition.name), definition.name in wanted
        if is_read or (sample is not None and definition.op != "expression"):
            wanted.update(definition.reads)
            is_own = sample is not None and definition.of in own and not definition.formulas and not definition.table
            found.append(Part(index, sample, is_read, definition.of if is_own and definition.op in OPS else ""))
    return tuple(reversed(found))


def _sampler(
    definition: Definition,
    tests: Sequence[AtomTest],
    own: Collection[str],
    reserved: Collection[str],
    derived: Mapping[str, Sampler],
) -> Sampler | None:
    if definition.events:
        return sample_of_events(definition.events, definition.tested, tests, reserved)
    if definition.formula is not None:
        of_formula = tuple(test for test in tests if test.index < len(definition.tested))
        reads = frozenset[str]().union(*(test.reads for test in of_formula)) - frozenset(reserved)
        return sample_of_formula(definition.formula, of_formula, reads)
    if definition.op == "expression":
        here = [name for name in definition.operands if name in own]
        above = [name for name in definition.operands if name in derived]
        return sample_of_any(here, above) if here or above else None
    found = _of_signal(definition.of, OPS[definition.op].numbers, own, reserved, derived)
    return found if found is None or definition.table is None else sample_of_value(found, definition.table.events)


def _of_signal(
    name: str, numbers: bool, own: Collection[str], reserved: Collection[str], derived: Collection[str]
) -> Sampler | None:
    if name in derived:
        return sample_of_derived(name, numbers)
    if name in reserved:
        return sample_of_reserved(name, numbers)
    return sample_of(name, numbers) if name in own else None


def watched(definitions: Sequence[Definition], properties: Sequence[tuple[int, Sequence[Atom]]]) -> tuple[Watched, ...]:
    """What is asked at ticks of signals that time changes, by the atoms of timed properties that may hold there."""
    places = {d.name: i for i, d in enumerate(definitions) if d.changes}
    ages = frozenset(d.name for d in definitions if d.op == "age")
    asked: dict[int, dict[Constraint, set[int]]] = {}
    for prop, found in properties:
        for constraint in (c for atom in found for each in atom.constraints for c in _sides(each)):
            if constraint.key in places:
                asked.setdefault(places[constraint.key], {}).setdefault(constraint, set()).add(prop)
    return tuple(
        Watched(
            index,
            tuple(by),
            tuple(frozenset(found) for found in by.values()),
            abreast=ages if definitions[index].name in ages else frozenset(),
            moving=frozenset() if definitions[index].name in ages else frozenset(places),
            compares=any(isinstance(constraint.value, Signal) for constraint in by),
        )
        for index, by in asked.items()
    )


def _sides(constraint: Constraint) -> tuple[Constraint, ...]:
    """A constraint as one of each signal that it is of."""
    return (constraint, turned(constraint)) if isinstance(constraint.value, Signal) else (constraint,)
