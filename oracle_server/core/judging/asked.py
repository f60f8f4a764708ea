"""Properties of which nothing was asked: what stands left of their `->` never held, or no scope was open."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from typing import NamedTuple, Self

from oracle_server.core.atoms import Match
from oracle_server.core.formula.conditions import Condition, conditions, may_hold, needed, spine, without
from oracle_server.core.formula.render import render, render_atom
from oracle_server.core.formula.tree import And, Atom
from oracle_server.core.snapshot import WatchSnapshot
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import Outcome


class Idle(NamedTuple):
    """A property of which nothing was asked, and the atoms for want of which; none where parts never held together."""

    property: Property
    atoms: tuple[Atom, ...]
    part: str
    """What never held, in the formula's words."""


class Watch:
    """What one property waits for: that some condition may have held, and atoms that never did.

    What was seen is not unseen where the judge goes back: no event is taken away by one that comes late.
    """

    def __init__(self, prop: Property, found: tuple[Condition, ...]) -> None:
        self.property, self._conditions = prop, found
        self._places = {atom: place for place, atom in enumerate(prop.atoms)}
        parts = [part for condition in found for part in condition]
        self._missing = {self._places[atom] for part in parts for atom in needed(part)}
        """The places of the atoms that never held."""
        self._at_once = [(self._required(condition), condition) for condition in found]
        self._asked = any(self._may_hold(condition, [None] * len(prop.atoms)) for condition in found)
        self._lacks = self._lacking()
        self._why: Idle | None = None

    @property
    def is_open(self) -> bool:
        """Whether nothing was asked yet."""
        return self._lacks is not None

    def see(self, found: Sequence[Match]) -> Self | None:
        """See which atoms hold at a step; None where something may have been asked."""
        came = [place for place in self._missing if found[place] is not None]
        asked = self._asked or any(
            all(found[place] is not None for place in places) and self._may_hold(condition, found)
            for places, condition in self._at_once
        )
        if came or asked is not self._asked:
            self._missing.difference_update(came)
            self._asked, self._why = asked, None
            self._lacks = self._lacking()
        return self if self.is_open else None

    def why(self) -> Idle:
        """Why nothing was asked of it, where it is open."""
        if self._why is None:
            part = " or ".join(render_atom(atom) for atom in dict.fromkeys(self._lacks or ()))
            part = part or render(reduce(And, self._conditions[0]), self.property.time)
            self._why = Idle(self.property, self._lacks or (), part)
        return self._why

    def snapshot(self) -> WatchSnapshot:
        """What was not seen yet, as plain data."""
        return {"asked": self._asked, "missing": sorted(self._missing)}

    def restored(self, data: WatchSnapshot | None) -> Self | None:
        """The same as a snapshot has it; None where nothing is left to be seen, or an older version did not look."""
        if data is None:
            return None
        self._asked, self._missing = data["asked"], set(data["missing"])
        self._lacks, self._why = self._lacking(), None
        return self if self.is_open else None

    def _lacking(self) -> tuple[Atom, ...] | None:
        """The atoms for want of which nothing was asked, empty where parts never held together; None where it was."""
        found = [without(reduce(And, condition), self._never) for condition in self._conditions]
        return None if self._asked and not all(found) else found[0]

    def _required(self, condition: Condition) -> list[int]:
        """The places of the atoms that must all hold at the step itself: most steps lack one of them."""
        return [self._places[part] for whole in condition for part in spine(whole) if isinstance(part, Atom)]

    def _may_hold(self, condition: Condition, found: Sequence[Match]) -> bool:
        return all(may_hold(part, lambda atom: found[self._places[atom]] is not None) for part in condition)

    def _never(self, atom: Atom) -> bool:
        return self._places[atom] in self._missing


def watch(prop: Property) -> Watch | None:
    """What a property waits for before it asks anything; None where it does so at every step, or that is not known."""
    found = () if prop.external or prop.numeric else conditions(prop.formula)
    one = Watch(prop, found) if found else None
    return one if one is not None and one.is_open else None


def unasked(seen: Watch | None, outcome: Outcome) -> Idle | None:
    """Why nothing was asked of a property that holds for want of that; None of one that is decided, or not judged."""
    return None if seen is None or outcome is not Outcome.CURRENTLY_TRUE else seen.why()


def told(idle: Sequence[tuple[str, str]]) -> Iterator[str]:
    """That nothing was asked of these properties, each with what never held, in one line however many they are."""
    if idle:
        names = [f"{name} (`{part}` never held)" for name, part in idle[:_MOST]]
        more = [f"{len(idle) - _MOST} more"] if len(idle) > _MOST else []
        listed = [*names, *more]
        *first, last = listed
        yield f"nothing was asked of {', '.join(first)}{' and ' if first else ''}{last}"


def briefly(names: Sequence[str]) -> str:
    """The same for a list of many sessions, without what never held; empty where there are no such properties."""
    few = ", ".join(names[:_FEW])
    more = f" and {len(names) - _FEW} more" if len(names) > _FEW else ""
    return f"nothing was asked of {few}{more}" if names else ""


_MOST = 8
"""Properties that are named with what never held."""
_FEW = 3
"""Properties that a list of many sessions names."""
