"""What the reference expects of a case: its rows, ticks included."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from oracle_server.core.atoms import canonical
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Constraint, Scalar, Signal
from oracle_server.core.spec import Property
from tests.core.derived.cases import HELD, SIGNALS, Case, Row
from tests.core.derived.reference import FAILED, Failed, Step, Value, changes


@dataclass
class Expected:
    """Judges a case by the reference: all of it, or without `judge` what it is told to take."""

    case: Case
    judge: bool = True
    steps: list[Step] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    held: dict[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.reference = self.case.reference
        self.outcomes = ["unknown"] * len(self.case.spec.properties)
        times = [time for time, _, _ in self.case.events]
        self.begun, self.ticked = self.case.begun, 0
        for i, (time, _, _) in enumerate(self.case.events if self.judge else ()):
            self._ticks(time)
            self._step(i)
        if self.judge:
            self._ticks(self.case.end)
            assert times == sorted(times)

    def take(self, index: int) -> Step:
        """Take an event as the next step."""
        step, self.held = self._made(index)
        self.steps.append(step)
        return step

    def _made(self, index: int) -> tuple[Step, dict[str, Value]]:
        """The step that an event would be next, and what is held behind it."""
        time, name, data = self.case.events[index]
        self.begun = min(self.begun, time)
        own = {k: v for k, v in data.items() if not isinstance(v, dict)}
        failed = {k for k, v in data.items() if isinstance(v, dict)}
        held = dict(self.held)
        for key in HELD & set(SIGNALS[name]):
            held.pop(key, None)
            if key in data:
                held[key] = FAILED if key in failed else own[key]
        seen, lost = _together(held)
        seen = {key: value for key, value in seen.items() if key not in failed}
        step = Step(time, len(self.steps) + 1, name, own, failed, {**seen, "topic": name, **own},
                    failed | (lost - own.keys()))  # fmt: skip
        self.reference.take(self.steps, step, self.begun)
        return step, held

    def _step(self, index: int) -> None:
        step, held = self._made(index)
        time, name, _ = self.case.events[index]
        outcomes = [self._outcome(p, step) for p in self.case.spec.properties]
        self.rows.append((name, time, tuple(outcomes)))
        guards = [o for p, o in zip(self.case.spec.properties, outcomes, strict=True) if name in p.guards]
        if any(o != "currently_true" for o in guards):
            return
        self.outcomes, self.held = outcomes, held
        self.steps.append(step)

    def _outcome(self, prop: Property, step: Step) -> str:
        holds = self.reference.holds(prop.formula, step)
        return "unknown" if holds is None else "currently_true" if holds else "currently_false"

    def _ticks(self, until: int) -> None:
        """Judge all ticks before a time."""
        timed = [i for i, p in enumerate(self.case.spec.properties) if p.time == "seconds"]
        present = self.steps[-1].time if self.steps else self.begun
        asked = {i: self._asked(self.case.spec.properties[i]) for i in timed}
        found = self._changes([c for cs in asked.values() for c in cs])
        turned: set[int] = set()
        by_key: dict[tuple[str, str], set[int]] = {}
        bys = {d.name: d.by for d in self.case.spec.derive}
        timely = {d.name for d in self.case.spec.derive if d.op == "age" or (d.over and not d.counted)}
        for time in sorted({t for t in found if present < t < until}) if timed else ():
            own = [(i, c) for i in timed for c in asked[i] if any(not bys[n] for n in _sides(c) & timely)]
            plain = {i for i, c in own if self._turns(c, time)}
            keyed = []
            for (text, by), names in sorted(self.reference.keys(self.steps, _together(self.held)[0], time).items()):
                carried = {by: json.loads(text)}
                own = [
                    (i, c) for i in timed for c in asked[i] if any(bys[n] == (by,) for n in _sides(c) & timely & names)
                ]
                due = {i for i, c in own if self._turns(c, time, carried)}
                if due:
                    by_key.setdefault((by, text), set()).update(due)
                    keyed.append(carried)
            turned |= plain
            for carried in ([{}] if plain else []) + keyed:
                if time > self.ticked:  # else it was judged before an event that was taken back
                    self._tick(time, carried, turned, by_key)
        self.ticked = until - 1

    def _tick(
        self, time: int, carried: Mapping[str, Scalar], turned: set[int], by_key: Mapping[tuple[str, str], set[int]]
    ) -> None:
        tick = self._at(time, carried)
        due = {*turned}
        for (by, value), properties in by_key.items():
            if by in tick.seen and canonical(tick.seen[by]) == value:
                due |= properties
        outcomes = [self._outcome(p, tick) if i in due else self.outcomes[i]
                    for i, p in enumerate(self.case.spec.properties)]  # fmt: skip
        if outcomes != self.outcomes:
            self.outcomes = outcomes
            self.rows.append(("", time, tuple(outcomes)))

    def _asked(self, prop: Property) -> list[Constraint]:
        found = [a for a in tree.atoms(prop.formula) if self.reference.reads(a, "")]
        return [c for a in found for c in a.constraints if c.key != "topic"]

    def _turns(self, constraint: Constraint, time: int, carried: Mapping[str, Scalar] | None = None) -> bool:
        before, now = (self._answer(constraint, self._at(t, carried or {})) for t in (time - 1, time))
        if self.steps:
            before, now = before or False, now or False
        return before != now

    def _answer(self, constraint: Constraint, step: Step) -> str | bool | None:
        if _sides(constraint) & step.failed:
            return "failed"
        if not _sides(constraint) <= step.seen.keys():
            return None
        return self.reference.holds(tree.Atom((constraint,)), step)

    def _changes(self, asked: Sequence[Constraint]) -> set[int]:
        """Times at which an answer may turn, and many more."""
        definitions = self.case.spec.derive
        limits: set[object] = {c.value for c in asked}
        found = {*changes(definitions, self.steps, limits, self.begun)}
        ages = {d.name for d in definitions if d.op == "age"}
        beside = {name for c in asked if isinstance(c.value, Signal) and _sides(c) & ages for name in _sides(c) - ages}
        if beside:
            now = self.steps[-1].time if self.steps else self.begun
            seen = [self._at(time, {}).seen for time in {now, *found}]
            limits |= {signals[name] for signals in seen for name in beside & signals.keys()}
            found |= {*changes(definitions, self.steps, limits, self.begun)}
        return found

    def _at(self, time: int, carried: Mapping[str, Scalar]) -> Step:
        seen, failed = _together(self.held)
        return self.reference.tick(self.steps, time, {**seen, **carried}, failed - carried.keys(), self.begun)


def _sides(constraint: Constraint) -> set[str]:
    """The signals that a constraint is of."""
    return {constraint.key, constraint.value.name} if isinstance(constraint.value, Signal) else {constraint.key}


def _together(held: Mapping[str, Value]) -> tuple[dict[str, Scalar], set[str]]:
    seen = {k: v for k, v in held.items() if v is not None and not isinstance(v, Failed)}
    return seen, {k for k, v in held.items() if isinstance(v, Failed)}
