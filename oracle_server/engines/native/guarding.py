"""The engine of a guard: it tells which steps break what is asked by `always`, also where that was decided before."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import reduce
from itertools import combinations
from typing import Any, NamedTuple

from oracle_server.core.atoms import Match, Matches
from oracle_server.core.errors import EngineError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import obligation
from oracle_server.core.formula.breach import breach, unlimited
from oracle_server.core.formula.outline import free
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Formula
from oracle_server.core.lost import Lost
from oracle_server.core.spec import Property
from oracle_server.core.verdicts import NEGATIVE, Outcome
from oracle_server.engines.native.engine import NativeEngine

_TRUE: Match = ()
_MOST_NAMES = 3
"""Most variables of an atom whose values are told apart where it can't be judged; with more it can't for any."""


class _Failing(NamedTuple):
    """That an atom can't be judged where `names` have the values that the step has: of its `free` ones those known."""

    of: Atom
    free: tuple[str, ...]
    names: tuple[str, ...]


class GuardingEngine(NativeEngine):
    """A native engine with a second one beside it, for the formula of what breaks its obligations, where it has any.

    An obligation is decided once, by the first step that breaks it; those that come after it are to be denied as well.
    """

    def __init__(self, formula: Formula, time: Time = "steps", share: float = 1, *, guards: bool = True) -> None:
        """`share` is the part of an engine's cost limit that each of both may use; `guards`: it decides events."""
        super().__init__(formula, time, share)
        found = obligation(formula) if guards else None
        self._failing: dict[Atom, _Failing] = {}
        """What holds for the second engine where an atom can't be judged."""
        broken = None if found is None else breach(found, self._surely)
        self.breaks = False
        """Whether the last step broke what is asked by `always`, be it decided before or not."""
        self._saved_as = "breaking by values" if self._failing else "breaking"
        """The key of the second engine's snapshot: another one where an older version had other nodes."""
        self._beside = None if broken is None else NativeEngine(broken, time, share)
        self._own = tree.atoms(formula)
        self._lost: Mapping[Atom, Mapping[str, str]] = {}
        """The atoms that can't be judged at the next step, each with the values of the variables that are known."""
        known = {unlimited(atom): place for place, atom in enumerate(self._own)}
        self._places = [known.get(atom, atom) for atom in (() if broken is None else tree.atoms(broken))]

    def step(self, time: int, matches: Matches) -> Outcome:
        """Judge the next step; see `Engine.step`."""
        outcome = super().step(time, matches)
        if self._beside is not None:
            assert self.owed is not None  # noqa: S101 -- it asks for something
            decided = self.owed.now  # time may have gone on further than to the step, and decided what was asked
            self._beside.count_from(decided if self._timed and decided > time else 0)
            seen = [matches[place] if isinstance(place, int) else self._of(place) for place in self._places]
            self.breaks = self._beside.step(time, seen) not in NEGATIVE
            self._lost = {}
        return outcome

    def lose(self, lost: Collection[Lost]) -> None:
        """For the next step alone: these atoms can't be judged; see `Owing`."""
        super().lose(lost)
        self._lost = {self._own[place]: _known(self._own[place], values) for place, values in lost}

    def _of(self, atom: Atom) -> Match:
        """Whether an atom holds that the formula does not have: `true`, or that something can't be judged."""
        if atom == tree.TRUE:
            return _TRUE
        failing = self._failing[atom]
        known = self._lost.get(failing.of)
        if known is None or failing.names != tuple(name for name in failing.free if name in known):
            return None
        return tuple(known[name] for name in failing.names)

    def _surely(self, part: Formula) -> Formula:
        """A part that asks for something, where it can be judged: an atom that can't be does not hold, as it is."""
        if _needs_all(part):
            return part
        return reduce(lambda found, failing: tree.And(found, tree.Not(failing)), self._failings(part), part)

    def _failings(self, part: Formula) -> Iterator[Atom]:
        """What holds where a part can't be judged: an atom for each set of variables whose values may be known."""
        apart = free(part)
        for atom in tree.atoms(part):
            names = tuple(dict.fromkeys(name for _, name in atom.refs if name in apart))
            names = names if len(names) <= _MOST_NAMES else ()
            for count in range(len(names) + 1):
                for some in combinations(names, count):
                    key = f"*{len(self._failing)}"  # no signal has such a name
                    refs = [tree.Constraint(f"{key}{name}", "==", tree.Ref(name)) for name in some]
                    failing = Atom((tree.Constraint(key, "==", tree.Any.ANY), *refs))
                    self._failing[failing] = _Failing(atom, names, some)
                    yield failing

    @property
    def work(self) -> int:
        """What the last step cost, in values that were looked at."""
        return self._timeline.work + (0 if self._beside is None else self._beside.work)

    def allow(self, work: int) -> None:
        """Let it look at so many values for a step; see `Bounded.allow`."""
        super().allow(work)
        if self._beside is not None:
            self._beside.allow(work)

    def mark(self) -> None:
        """Note all changes from now on, until `back` or `keep`; marks can be nested."""
        super().mark()
        if self._beside is not None:
            self._beside.mark()

    def back(self) -> None:
        """Take back all steps since the last mark; what the last one broke is not told again."""
        super().back()
        if self._beside is not None:
            self._beside.back()

    def keep(self) -> None:
        """Keep the steps since the last mark."""
        super().keep()
        if self._beside is not None:
            self._beside.keep()

    def snapshot(self) -> dict[str, Any]:
        """All that later verdicts and decisions depend on, as plain data that JSON can represent."""
        saved = super().snapshot()
        return saved if self._beside is None else {**saved, self._saved_as: self._beside.snapshot()}

    def restore(self, data: Mapping[str, Any]) -> None:
        """Continue from a snapshot of the same formula, before the first step.

        Raises `EngineError` where it was taken by a version that keeps other things.
        """
        if self._beside is not None:
            if self._saved_as not in data:
                raise EngineError("a snapshot of a version that kept other things of obligations which were decided")
            self._beside.restore(data[self._saved_as])
        super().restore(data)


def engine_of(prop: Property, share: float = 1) -> NativeEngine:
    """A fresh native engine for a property, which may cost a `share` of what engines may."""
    if not prop.guards:
        return NativeEngine(prop.formula, prop.time, share)
    return GuardingEngine(prop.formula, prop.time, share)


def _known(atom: Atom, values: Sequence[str | None]) -> dict[str, str]:
    """The variables that an atom binds and whose values are known; behind those stands what it compares with others."""
    return {name: value for (_, name), value in zip(atom.refs, values, strict=False) if value is not None}


def _needs_all(part: Formula) -> bool:
    """Whether a part holds only where each of its atoms does, at the same step."""
    return isinstance(part, Atom) or (isinstance(part, tree.And) and _needs_all(part.left) and _needs_all(part.right))
