"""The derived signals of one order of events."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

from oracle_server.core.derived.age import Age
from oracle_server.core.derived.arithmetic import Arithmetic
from oracle_server.core.derived.counts import Count, Rate
from oracle_server.core.derived.definition import Definition
from oracle_server.core.derived.extremes import Extreme
from oracle_server.core.derived.journal import Undo, Was, take_back
from oracle_server.core.derived.keyed import Keyed, key_of, value_of
from oracle_server.core.derived.latest import Delta, Last, Previous
from oracle_server.core.derived.layout import Layout, Part
from oracle_server.core.derived.machine import Machines
from oracle_server.core.derived.parametric import Parametric
from oracle_server.core.derived.samples import FAILED, NOTHING, Lack
from oracle_server.core.derived.sums import Mean, Sum
from oracle_server.core.derived.watch import Carried, Watch
from oracle_server.core.derived.window import Series, Session
from oracle_server.core.derived.words import lack, told
from oracle_server.core.events import Signals, Step
from oracle_server.core.formula.tree import Atom, Scalar

_MAKE: Mapping[str, Callable[[Definition, Session], Series]] = {
    "expression": Arithmetic,
    "count": Count,
    "rate": Rate,
    "sum": Sum,
    "mean": Mean,
    "min": Extreme,
    "max": Extreme,
    "last": Last,
    "previous": Previous,
    "delta": Delta,
    "age": Age,
    "states": Machines,
    "follows": Machines,
    "sequence": Machines,
}
Names = frozenset[str] | set[str]
_NOTHING: tuple[Signals, frozenset[str]] = {}, frozenset()
_NONE: set[str] = set()
"""The derived signals of which a step has a sample, where nobody asks: never changed."""


class LastStep(NamedTuple):
    """The last step: its time (ns), its number, or 0 before the first one, and what is held, or has failed, since.

    `ticked`: until when (ns) all ticks since then were judged.
    """

    present: int
    steps: int
    ticked: int
    held: Callable[[], tuple[Signals, Names]]


class Turn(NamedTuple):
    """A tick that is due: the signals that it carries, and the properties whose deadline it is, all keys aside."""

    carried: Signals
    turned: Collection[int]


_PLAIN = Turn({}, ())
"""A tick that is due for the deadlines of engines alone."""


class Derived:
    """Computes derived signals step by step. All of its state can be taken back by its journal."""

    def __init__(self, layout: Layout | None) -> None:
        """Compute what a layout has; without one, nothing."""
        layout = self._layout = layout or Layout(())
        self._session = Session()
        self.journal = self._session.journal
        """What takes changes back: `mark`, then `back` or `keep`."""
        self._names = [d.name for d in layout.definitions]
        self._series = [_made(d, self._session) for d in layout.definitions]
        self._chained = any(name in d.reads for d in layout.definitions for name in self._names)
        """Whether some are computed of others."""
        self._bys = ["".join(d.by[:1]) for d in layout.definitions]
        self._bound: dict[int, list[Any]] = {}
        self._silent = [(self._series[p.index], self._names[p.index]) for p in layout.silent]
        self._watch: tuple[int, int, Watch] | None = None
        self._sees = bool(layout.keys) or any(w.compares for w in layout.watched)
        """Whether what is held matters to what turns."""
        self._due: list[Carried] = []
        """The keys for which a tick at the last one's time is still due."""

    def begin(self, time: int) -> None:
        """Begin at a time (ns)."""
        self._session.begun, self._watch = time, None

    def step(
        self,
        parts: tuple[Part, ...],
        step: Step,
        signals: dict[str, Scalar],
        failed: Names,
        now: int,
        number: int,
    ) -> Names:
        """Take step `number`, at `now` (ns): adds what is derived to its signals; returns all that failed."""
        begun = self._session.begun
        if begun is None or now < begun:
            self._begin_before(now)
        bound = self._bound.get(id(parts)) or self._bind(parts)
        chained, of_event = self._chained, step.signals
        fresh: set[str] = set() if chained else _NONE
        for take, value_of_it, sample, own, name, wanted in bound:
            found: Any = of_event.get(own) if own else None
            if type(found) is not float:  # else `sample` has it so, too
                found = NOTHING if sample is None else sample(step, signals, failed, fresh)
            if found is not NOTHING:
                value = take(found, now, number, signals, failed)
                if chained:
                    fresh.add(name)
            elif wanted:
                value = value_of_it(now, number, signals, failed)
            if wanted:
                if value is FAILED:
                    failed = frozenset((*failed, name))
                elif value is not None:
                    signals[name] = value
        return failed

    def at(self, time: int, number: int, signals: Signals, failed: Names) -> tuple[Signals, Names]:
        """The signals of a tick behind step `number`, with what is derived; and all that failed."""
        if not self._silent:
            return signals, failed
        more = dict(signals)
        for series, name in self._silent:
            value = series.at(time, number, more, failed)
            if isinstance(value, Lack):
                failed = frozenset((*failed, name))
            elif value is not None:
                more[name] = value
        return more, failed

    def back(self) -> None:
        """Take back all steps since the last mark."""
        self._watch = None
        self.journal.back()

    def record(self) -> None:
        """From now on, keep what is needed to go back: `noted` tells it after each step."""
        if self._series:
            self.journal.record()

    def noted(self) -> tuple[Undo, ...]:
        """What takes back the changes since this was called last; `record` was called, and no mark is open."""
        return self.journal.noted() if self._series else ()

    def rewind(self, steps: Iterable[Sequence[Undo]]) -> None:
        """Go back over steps by what was `noted` of each, the last one first."""
        self._watch, self._due = None, []
        for noted in steps:
            take_back(noted)

    def next_deadline(self, after: int, last: LastStep) -> int | None:
        """When, later than `after` (ns), what is asked of derived signals may turn without a step; None for never."""
        if not self._layout.watched or self._session.begun is None:
            return None
        return self._watching(last).next_change(after)

    def is_due(self, present: int, steps: int) -> bool:
        """Whether another tick is due at the time of the last one, which came behind the last of `steps`."""
        return bool(self._due) and self._watch is not None and self._watch[:2] == (present, steps)

    def turn(
        self, time: int, last: LastStep, runs_out: Callable[[int], bool], recorded: Signals | None = None
    ) -> Turn | None:
        """The next tick that is due at a time, None where none is.

        `runs_out` returns whether one is due there for another reason; `recorded` are the signals of one that was
        judged before.
        """
        if not self._series:
            return _PLAIN
        if recorded is not None:
            return self._turn_again(time, last, recorded)
        if self._session.begun is None:
            return _PLAIN if runs_out(time) else None
        watch = self._watching(last)
        plain = False
        if not self._due:
            plain, self._due = watch.look(time)
            plain = runs_out(time) or plain
        if plain:
            return Turn({}, watch.turned)
        if not self._due:
            return None
        by, key = self._due.pop(0)
        return Turn({by: value_of(key)}, watch.turned)

    def _turn_again(self, time: int, last: LastStep, signals: Signals) -> Turn:
        carried = {by: signals[by] for by in self._layout.keys if by in signals}
        if self._session.begun is None:
            return Turn(carried, ())
        watch = self._watching(last)
        _, due = watch.look(time)
        self._due = due or self._due
        held, _ = last.held()
        for by, value in carried.items():
            key = by, key_of(value)
            if key in self._due and (by not in held or key_of(held[by]) != key[1]):  # those before changed nothing
                self._due = self._due[self._due.index(key) + 1 :]
        return Turn(carried, watch.turned)

    def turned_for(self, signals: Signals, last: LastStep) -> set[int]:
        """The properties whose deadline a tick with these signals is for the sake of its keys."""
        if not self._layout.keys or self._session.begun is None:
            return set()
        keys = self._watching(last).keys
        return set[int]().union(*(keys.get(each, ()) for each in self.seen(signals)))

    def seen(self, signals: Signals) -> frozenset[Carried]:
        """What tells ticks of one time apart, by their signals: the keys that are carried or held."""
        return frozenset((by, key_of(signals[by])) for by in self._layout.keys if by in signals)

    def told(
        self, atoms: Collection[Atom], signals: Signals, failed: Names, time: int, named: Callable[[int], str]
    ) -> list[str]:
        """What derived signals of some atoms are at a step or tick, at a time (ns), and what of; not absent ones.

        `named` names a step by its place.
        """
        there = [(d, series) for d, series in self._of(atoms) if d.name in signals or d.name in failed]
        return [told(d, series, signals, time, named) for d, series in there]

    def complaint(self, atoms: Collection[Atom]) -> str | None:
        """Why derived signals of some atoms have failed for want of room, None where none has."""
        found = [f"{d.name} has failed: {reason}" for d, series in self._of(atoms) if (reason := lack(series))]
        return "; ".join(found) or None

    def _of(self, atoms: Collection[Atom]) -> list[tuple[Definition, Series]]:
        if not self._series:
            return []
        names = {c.key for atom in atoms for c in atom.constraints}
        pairs = zip(self._layout.definitions, self._series, strict=True)
        return [(d, series) for d, series in pairs if d.name in names]

    def snapshot(self) -> Any:
        """All that later values depend on, as plain data; None where there are none."""
        if not self._series:
            return None
        return {"begun": self._session.begun, "series": [series.snapshot() for series in self._series]}

    def restore(self, data: Any) -> None:
        """Take over a snapshot."""
        if not self._series:
            return
        self._session.begun = data["begun"]
        for series, saved in zip(self._series, data["series"], strict=True):
            series.restore(saved)

    def _watching(self, last: LastStep) -> Watch:
        present, steps, ticked, held = last
        if self._watch is None or self._watch[:2] != (present, steps):
            signals, failed = held() if self._sees else _NOTHING

            def see(time: int, carried: Signals) -> tuple[Signals, Names]:
                return self.at(time, steps, {**signals, **carried}, failed - carried.keys())

            watch = Watch(self._layout.watched, self._series, self._bys, self._session, present, steps, signals, see)
            watch.look(ticked)
            self._watch = present, steps, watch
            self._due = []
        return self._watch[2]

    def _begin_before(self, now: int) -> None:
        """Begin with a step that is older than the session: nothing is."""
        if self.journal.entries is not None:
            self.journal.entries.append(Was(self._session, "begun", self._session.begun))
        self._session.begun = now

    def _bind(self, parts: tuple[Part, ...]) -> list[Any]:
        """What is called for the parts of a stream."""
        found = [(self._series[p.index], p.sample, p.own, self._names[p.index], p.wanted) for p in parts]
        return self._bound.setdefault(id(parts), [(s.take, s.value, *rest) for s, *rest in found])


def _made(definition: Definition, session: Session) -> Series:
    if len(definition.by) > 1:
        return Parametric(definition, session)
    make = partial(_MAKE[definition.op], definition, session)
    return Keyed(definition, make, session) if definition.by and definition.table is None else make()
