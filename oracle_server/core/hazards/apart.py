"""Signals that are held for one monitor, and read at the events of another, which do not see them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from typing import NamedTuple

from oracle_server.core.events import StreamKey
from oracle_server.core.formula.tree import TRUE, And, Atom, Formula, Implies, Or, atoms, children
from oracle_server.core.hazards.withholding import present
from oracle_server.core.plan import can_meet
from oracle_server.core.spec import Property, Spec, StreamSpec
from oracle_server.core.units import counted

Monitors = Mapping[StreamKey, Set[str]]
"""The monitors of each stream."""
_MOST = 100_000
"""Up to so many pairs of atoms of a formula, at all streams and of as many properties, what decides it is looked at."""
_FEW = 3
"""Monitors that are told by their names, where there are many."""


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
    """What each property does not see, by the monitors of streams: two of which none has both are apart.

    Of a spec of many streams and long formulas it is told, too, where one side of a formula decides it whatever the
    other says: sessions wait for this.
    """
    holders = {name: stream.key for stream in spec.streams for name in sorted(stream.hold)}
    keys = [stream.key for stream in spec.streams]
    apart = [_apart_from(key, spec, monitors) for key in keys]
    if not any(apart):
        return
    for prop in spec.properties:
        found: dict[str, set[int]] = {}
        for name, i in (each for formula in _read(spec, prop) for each in _missed(spec, formula, apart)):
            found.setdefault(name, set()).add(i)
        for name in filter(found.__contains__, holders):
            yield Unseen(prop.id, holders[name], name, tuple(keys[i] for i in sorted(found[name])))


def _missed(spec: Spec, formula: Formula, apart: Sequence[frozenset[str]]) -> Iterator[tuple[str, int]]:
    """What a formula asks for that is not seen, and at which streams; `apart` is what each does not see."""
    tested = {atom: _keys(spec, [atom]) for atom in atoms(formula)}
    read = frozenset[str]().union(*tested.values())
    named = {(c.key, c.value) for atom in tested for c in atom.constraints if c.op == "=="}
    is_short = len(tested) ** 2 * len(spec.streams) * len(spec.properties) <= _MOST
    for i, stream in enumerate(spec.streams):
        own = (stream.signals or {}).keys()
        missed = read & apart[i] - own
        if missed and ((stream.traits.group, stream.name) in named or not own.isdisjoint(read)):
            for name in missed & _open_keys(formula, tested, stream) if is_short else missed:
                yield name, i


def _apart_from(one: StreamKey, spec: Spec, monitors: Monitors) -> frozenset[str]:
    """The signals that are held by streams of which no monitor tells that tells of this one."""
    return frozenset[str]().union(*(s.hold for s in spec.streams if s.hold and _are_apart(s.key, one, monitors)))


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


def _open_keys(formula: Formula, tested: Mapping[Atom, frozenset[str]], stream: StreamSpec) -> frozenset[str]:
    """The signals that may matter to a formula at the events of a stream, of those that its atoms read."""
    known = {atom: _known(atom, stream) for atom in tested}
    open_ = (node for node in _open(formula, known.__getitem__) if isinstance(node, Atom))
    return frozenset[str]().union(*(tested[atom] for atom in open_))


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
    names = sorted(monitors)
    if len(names) > _FEW + 1:
        return f"{', '.join(names[:_FEW])} and {counted(len(names) - _FEW, 'other monitor')}"
    return " and ".join(names)
