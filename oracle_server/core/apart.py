"""Signals that are held for one monitor, and read at the events of another, which do not see them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import TRUE, And, Atom, Formula, Implies, Or, atoms, children
from oracle_server.core.plan import can_meet
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.withholding import present

Monitors = Mapping[StreamKey, Set[str]]
"""The monitors of each stream."""


class Unseen(NamedTuple):
    """A signal that a property does not see at some streams, as another monitor tells of them than holds it."""

    property: str
    holder: StreamKey
    name: str
    at: tuple[StreamKey, ...]

    def told(self, monitors: Monitors) -> tuple[str, str, str]:
        """Whose it is, and the streams at which it is not seen with whose these are, as people are told of them."""
        theirs = set[str]().union(*(monitors[key] for key in self.at))
        return _listed(monitors[self.holder]), ", ".join(map(str, self.at)), _listed(theirs)


def unseen(spec: Spec, monitors: Monitors) -> Iterator[Unseen]:
    """What each property does not see, by the monitors of streams: two of which none has both are apart."""
    apart = {
        name: (holder.key, others)
        for holder in spec.streams
        if holder.hold and (others := [s for s in spec.streams if _are_apart(holder.key, s.key, monitors)])
        for name in sorted(holder.hold)
    }
    for prop in spec.properties if apart else ():
        formulas = [(formula, _keys(spec, atoms(formula))) for formula in _read(spec, prop)]
        for name, (holder, others) in apart.items():
            asking = [formula for formula, keys in formulas if name in keys]
            at = tuple(s.key for s in others if any(_asks(spec, formula, name, s) for formula in asking))
            if at:
                yield Unseen(prop.id, holder, name, at)


def _are_apart(one: StreamKey, other: StreamKey, monitors: Monitors) -> bool:
    """Whether both are told of, and never by the same monitor."""
    first, second = monitors.get(one), monitors.get(other)
    return bool(first and second and first.isdisjoint(second))


def _read(spec: Spec, prop: Property) -> Iterator[Formula]:
    """The formula of a property, and those of the derived signals that it reads."""
    derived = {definition.name: definition for definition in spec.derive}
    waiting, seen = [] if prop.external else [prop.formula], set[str]()
    while waiting:
        formula = waiting.pop()
        yield formula
        for name in _keys(spec, atoms(formula)) & derived.keys() - seen:
            seen.add(name)
            waiting += derived[name].formulas


def _keys(spec: Spec, tested: Iterable[Atom]) -> frozenset[str]:
    """The signals that atoms read of a step: those that stand in them, and what expressions and keys take of it.

    All else that is derived has samples of its own, whoever sent them.
    """
    keys = {c.key for atom in tested for c in atom.constraints}
    for definition in reversed(spec.derive):  # each reads those above it alone
        if definition.name in keys:
            keys.update(definition.reads if definition.op == "expression" else definition.by)
    return frozenset(keys)


def _asks(spec: Spec, formula: Formula, held: str, stream: StreamSpec) -> bool:
    """Whether a formula asks of a stream, by its name or a signal of it, and what is held may matter at its events."""
    tested = atoms(formula)
    keys, own = _keys(spec, tested), stream.signals or ()
    if held in own:
        return False
    named = {c.value for atom in tested for c in atom.constraints if c.key == stream.traits.group and c.op == "=="}
    if stream.name not in named and keys.isdisjoint(own):
        return False
    reading = {atom for atom in tested if held in _keys(spec, [atom])}
    return any(node in reading for node in _open(formula, lambda atom: _known(atom, stream)))


def _known(atom: Atom, stream: StreamSpec) -> bool | None:
    """What is known of an atom at each event of a stream, whatever its message says."""
    return False if not can_meet(stream, atom) else True if atom == TRUE else None


def _open(formula: Formula, known: Callable[[Atom], bool | None]) -> Iterator[Formula]:
    """The parts of a formula that may decide it at an event: where one side does, the other does not matter."""
    waiting = [formula]
    while waiting:
        node = waiting.pop()
        yield node
        match node:
            case And(left, right) | Or(left, right) | Implies(left, right):
                by_right, by_left = not isinstance(node, And), isinstance(node, Or)  # what of each side decides alone
                waiting += [left] if present(right, known) is not by_right else []
                waiting += [right] if present(left, known) is not by_left else []
            case _:
                waiting += children(node)


def _listed(monitors: Set[str]) -> str:
    return " and ".join(sorted(monitors))
