"""Properties of which a recording asked nothing: what stands left of their `->` never held, or no scope was open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import NamedTuple

from oracle_server.core.atoms import Match
from oracle_server.core.events import Signals
from oracle_server.core.formula.conditions import Condition, conditions, may_hold, needed, spine, without
from oracle_server.core.formula.render import render, render_atom
from oracle_server.core.formula.tree import And, Atom
from oracle_server.core.kinds import NAMING
from oracle_server.core.plan import Plan, View, can_meet
from oracle_server.core.spec import Property, Spec
from oracle_server.replay.coverage import Coverage


class Idle(NamedTuple):
    """A property of which nothing was asked, and the atoms for want of which; none where parts never held together."""

    property: Property
    atoms: tuple[Atom, ...]
    part: str
    """What never held, in the formula's words."""


class Asked:
    """Watches what properties see, and tells of which of them nothing was asked."""

    def __init__(self, spec: Spec) -> None:
        """Begin with nothing seen."""
        self._spec = spec
        self._watches: dict[int, _Watch] = {}
        for i, prop in enumerate(spec.properties):
            found = () if prop.external or prop.numeric else conditions(prop.formula)
            if found:
                self._watches[i] = _Watch(prop, found)

    def watched(self, ready: Plan) -> Plan:
        """A plan whose views tell what is seen through them, until all that a property waits for was there."""
        streams = {k: replace(stream, views=self._through(stream.views)) for k, stream in ready.streams.items()}
        return replace(ready, streams=streams, silent=self._through(ready.silent))

    def _through(self, views: Sequence[View]) -> tuple[View, ...]:
        found = list(views)
        for i, watch in self._watches.items():
            view = views[i]
            if any(test.index in watch.missing for test in view.tests):
                found[i] = _WatchedView(view.size, view.tests, view.reads, view.observed, watch=watch)
        return (*found, *views[len(found) :])

    def idle(self, coverage: Coverage) -> Iterator[Idle]:
        """The properties of which nothing was asked, but where a silent stream or a missing signal is why."""
        for watch in self._watches.values():
            why = watch.why()
            if why is not None and not (why.atoms and all(self._is_silent(atom, coverage) for atom in why.atoms)):
                yield why

    def _is_silent(self, atom: Atom, coverage: Coverage) -> bool:
        """Whether none of the streams spoke that can meet an atom, or none had a signal that it reads."""
        if not any(coverage[s.key]["events"] for s in self._spec.streams if can_meet(s, atom)):
            return True
        counts = [[c["signals"][key] for c in coverage.values() if key in c["signals"]] for key in own(atom)]
        return any(found and not any(signal["present"] for signal in found) for found in counts)


def own(atom: Atom) -> frozenset[str]:
    """The signals that an atom reads, without those that say whose events it means."""
    return frozenset(c.key for c in atom.constraints) - NAMING


def told(idle: Sequence[Idle]) -> Iterator[str]:
    """That nothing was asked of these properties, in one line however many they are."""
    if idle:
        names = [f"{each.property.id} (`{each.part}` never held)" for each in idle[:_MOST]]
        more = [f"{len(idle) - _MOST} more"] if len(idle) > _MOST else []
        listed = [*names, *more]
        *first, last = listed
        yield f"nothing was asked of {', '.join(first)}{' and ' if first else ''}{last}"


_MOST = 8
"""Properties that are named with what never held."""


class _Watch:
    """What one property waits for: that some condition may have held, and atoms that never did."""

    def __init__(self, prop: Property, found: tuple[Condition, ...]) -> None:
        self.property, self._conditions = prop, found
        self._places = {atom: place for place, atom in enumerate(prop.atoms)}
        parts = [part for condition in found for part in condition]
        self.missing = {self._places[atom] for part in parts for atom in needed(part)}
        """The places of the atoms that never held."""
        self._at_once = [(self._required(condition), condition) for condition in found]
        self._asked = any(self._may_hold(condition, [None] * len(prop.atoms)) for condition in found)
        self.open = not self._asked or bool(self.missing)
        """Whether anything is left to be seen."""

    def see(self, found: Sequence[Match]) -> None:
        """See which atoms hold at a step."""
        self.missing = {place for place in self.missing if found[place] is None}
        if not self._asked:
            self._asked = any(
                all(found[place] is not None for place in places) and self._may_hold(condition, found)
                for places, condition in self._at_once
            )
        self.open = not self._asked or bool(self.missing)

    def why(self) -> Idle | None:
        """Why nothing was asked of it, None where something may have been."""
        found = [without(reduce(And, condition), self._never) for condition in self._conditions]
        if self._asked and not all(found):
            return None
        if found[0]:
            return Idle(self.property, found[0], " or ".join(render_atom(atom) for atom in dict.fromkeys(found[0])))
        return Idle(self.property, (), render(reduce(And, self._conditions[0]), self.property.time))

    def _required(self, condition: Condition) -> list[int]:
        """The places of the atoms that must all hold at the step itself: most steps lack one of them."""
        return [self._places[part] for whole in condition for part in spine(whole) if isinstance(part, Atom)]

    def _may_hold(self, condition: Condition, found: Sequence[Match]) -> bool:
        return all(may_hold(part, lambda atom: found[self._places[atom]] is not None) for part in condition)

    def _never(self, atom: Atom) -> bool:
        return self._places[atom] in self.missing


@dataclass(frozen=True, slots=True)
class _WatchedView(View):
    watch: _Watch = field(kw_only=True)

    def matches(self, signals: Signals) -> list[Match]:
        """The match of each atom, which the watch sees."""
        found = View.matches(self, signals)
        if self.watch.open:
            self.watch.see(found)
        return found
