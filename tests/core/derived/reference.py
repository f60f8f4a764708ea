"""The table of derived signals read literally: each is computed anew from the list of all steps, at every step."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

from oracle_server.core.atoms import canonical, meets, precedes
from oracle_server.core.derived.definition import Definition
from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Scalar, Signal
from tests.core.derived.machines import BLIND, UNKNOWN, Events, value_of

SECOND = 10**9


class Failed:
    """A value that is not known."""


FAILED: Final = Failed()
Value = Scalar | Failed | None
"""None: absent."""
Key = tuple[bool, Scalar] | None
ANY: Key = None
"""The key of what may have been any."""

Parts = tuple[Key, ...]
"""The keys of several values; None for one that a step does not have."""

EXPRESSIONS = ("- {}", "{} - {}", "{} * 2 + {}", "{}")


@dataclass
class Step:
    """A step: its time, number and stream, the event's own signals, and all that formulas see."""

    time: int
    number: int
    stream: str
    own: Mapping[str, Scalar]
    own_failed: Collection[str]
    seen: dict[str, Scalar]
    failed: set[str]
    fresh: set[str] = field(default_factory=set)
    taken: bool = False
    samples: dict[str, Value] = field(default_factory=dict)
    """What it is to each derived signal, once that is asked of a step that was taken: it changes no more then."""


@dataclass(frozen=True)
class Reference:
    """The derived signals of a spec; `streams` has the signals of each stream, `held` those that keep their values."""

    definitions: Sequence[Definition]
    streams: Mapping[str, Collection[str]]
    held: Collection[str]

    def take(self, steps: Sequence[Step], step: Step, begun: int) -> None:
        """Add what is derived to a step behind others."""
        history = [*steps, step]
        for d in self.definitions:
            if self._sample(d, step) is not None:
                step.fresh.add(d.name)
            self._put(step, d, self._value(d, history, step, step.time, step.number, begun))
        step.taken = True

    def tick(
        self, steps: Sequence[Step], time: int, seen: Mapping[str, Scalar], failed: Collection[str], begun: int
    ) -> Step:
        """What formulas see at a tick."""
        number = steps[-1].number if steps else 0
        tick = Step(time, number, "", {}, (), dict(seen), set(failed))
        for d in self.definitions:
            self._put(tick, d, self._value(d, steps, tick, time, number, begun))
        return tick

    def keys(self, steps: Sequence[Step], held: Mapping[str, Scalar], time: int) -> dict[tuple[str, str], set[str]]:
        """Signals and values by which something is known just before a time: by each as texts, of what it is known."""
        found: dict[tuple[str, str], set[str]] = {}
        for d, by in ((d, by_of(d)) for d in self.definitions):
            kept = d.over if d.over is not None and not d.counted else d.forget
            for step in steps if by else ():
                if by in step.seen and self._sample(d, step) is not None and (kept is None or step.time + kept >= time):
                    found.setdefault((canonical(step.seen[by]), by), set()).add(d.name)
            if by in held:
                found.setdefault((canonical(held[by]), by), set()).add(d.name)
        return found

    def reads(self, atom: Atom, stream: str) -> bool:
        """Whether an atom may hold at an event of a stream; "" for ticks."""
        derived = {d.name for d in self.definitions} | (
            {by for d in self.definitions for by in d.by} if not stream else set()
        )
        for c in atom.constraints:
            if c.key == "topic":
                if c.value != stream:
                    return False
            elif c.key not in self.streams.get(stream, ()) and c.key not in self.held and c.key not in derived:
                return False
        return True

    def holds(self, formula: Formula, step: Step) -> bool | None:
        """Whether a formula of one step holds; None where a signal of it has failed."""
        for atom in tree.atoms(formula):
            if self.reads(atom, step.stream) and any(c.key in step.failed for c in atom.constraints):
                return None
        return self._holds(formula, step)

    def _holds(self, formula: Formula, step: Step) -> bool:
        match formula:
            case tree.Atom(constraints):
                return all(_meets(c, step) for c in constraints)
            case tree.Not(operand):
                return not self._holds(operand, step)
            case tree.Or(left, right):
                return self._holds(left, step) or self._holds(right, step)
            case tree.And(left, right):
                return self._holds(left, step) and self._holds(right, step)
        raise TypeError(formula)

    def _put(self, step: Step, d: Definition, value: Value) -> None:
        if isinstance(value, Failed):
            step.failed.add(d.name)
        elif value is not None:
            step.seen[d.name] = value

    def _sample(self, d: Definition, step: Step) -> Value:
        """The sample that a step is, None where it is none."""
        if not step.taken:
            return self._sample_now(d, step)
        if d.name not in step.samples:
            step.samples[d.name] = self._sample_now(d, step)
        return step.samples[d.name]

    def _sample_now(self, d: Definition, step: Step) -> Value:
        if d.events:
            events: Value = self._events(d, step)
            return events
        if d.formula is not None:
            holds = self.holds(d.formula, step)
            return FAILED if holds is None else True if holds else None
        if d.op == "expression":
            own = {*step.own, *step.own_failed, *step.fresh}
            return True if own & set(d.operands) else None
        derived = {e.name for e in self.definitions}
        if d.of in derived:
            value: Value = None if d.of not in step.fresh else FAILED if d.of in step.failed else step.seen.get(d.of)
        else:
            value = FAILED if d.of in step.own_failed else step.own.get(d.of)
        if d.op not in ("last", "previous", "follows") and isinstance(value, str | bool):
            return FAILED
        return value

    def _value(self, d: Definition, history: Sequence[Step], step: Step, now: int, number: int, begun: int) -> Value:
        if d.op == "expression":
            return _evaluated(d.of, step)
        if len(d.by) > 1:
            return self._parametric(d, history, step, now)
        by = by_of(d)
        if by and by not in step.seen:
            return FAILED if by in step.failed else None
        samples = self._samples(d, history, _key(step.seen[by]) if by else ANY, now)
        if d.table is not None:
            return FAILED if (found := value_of(d, samples)) is UNKNOWN else found  # type: ignore[return-value]
        return self._computed(d, samples, history, step, now, number, begun)

    def _events(self, d: Definition, step: Step) -> Any:
        """The events of a machine that hold at a step, and those that may; None where there are none."""
        held = {e: self.holds(f, step) for e, f in zip(d.table.events, d.events, strict=True)}  # type: ignore[union-attr]
        found = Events([e for e in held if held[e]], [e for e in held if held[e] is None])
        return found if found.held or found.unsure else None

    def _samples(self, d: Definition, history: Sequence[Step], key: Key, now: int) -> list[tuple[Step, Value]]:
        """All samples of a key, but for those that are forgotten."""
        found: list[tuple[Step, Value]] = []
        newest, by = None, by_of(d)
        for step in history:
            sample = self._sample(d, step)
            if sample is None:
                continue
            if by and by not in step.seen:
                if by in step.failed:
                    found.append((step, FAILED))
                continue
            if by and _key(step.seen[by]) != key:
                continue
            found = [*_remembered(found, d, newest, step.time), (step, sample)]
            newest = step
        return found if newest is not None and _is_kept(d, newest, now) else _remembered(found, d, newest, now)

    def _parametric(self, d: Definition, history: Sequence[Step], step: Step, now: int) -> Value:
        """The value of a machine that is told apart by several signals: all that were made, rerun."""
        made: dict[Parts, list[tuple[Step, Any]]] = {}
        blind: list[tuple[Step, Any]] = []
        for each in history:
            sample, parts = self._sample(d, each), _parts(d, each)
            made = {key: told for key, told in made.items() if _is_kept(d, told[-1][0], each.time)}
            blind = [told for told in blind if _is_kept(d, told[0], each.time)]
            if sample is None:
                continue
            if any(by in each.failed for by in d.by):
                made, blind = {}, [(each, BLIND)]  # of any: none is remembered
            elif None not in parts:
                made.setdefault(parts, [*blind]).append((each, sample))
            else:
                for key in _agreeing(made, parts):
                    made[key].append((each, sample))
        if any(by in step.failed for by in d.by):
            return FAILED
        made = {key: told for key, told in made.items() if _is_kept(d, told[-1][0], now)}
        blind = [told for told in blind if _is_kept(d, told[0], now)]
        parts = _parts(d, step)
        if None not in parts:
            alone = value_of(d, made.get(parts, blind))
            return FAILED if alone is UNKNOWN else alone  # type: ignore[return-value]
        found = {value_of(d, made[key]) for key in _agreeing(made, parts)}
        assert d.table is not None
        if d.table.bad in found:
            return d.table.bad
        if UNKNOWN in found or (blind and any(part is not None for part in parts)):
            return FAILED
        return found.pop() if len(found) == 1 else None  # type: ignore[return-value]

    def _computed(
        self,
        d: Definition,
        samples: list[tuple[Step, Value]],
        history: Sequence[Step],
        step: Step,
        now: int,
        number: int,
        begun: int,
    ) -> Value:
        if d.over is not None:
            if not d.counted:
                samples = [(s, v) for s, v in samples if now - d.over < s.time <= now]
            elif d.formula is not None:
                samples = [(s, v) for s, v in samples if number - d.over < s.number <= number]
            else:
                samples = samples[-d.over :]
        values = [v for _, v in samples]
        if d.op in ("last", "age"):
            values = values[-1:]
        if d.op in ("previous", "delta"):
            if d.of not in step.seen and d.of not in step.failed:
                return None
            values = values[-2:]
        if any(isinstance(v, Failed) for v in values):
            return FAILED
        numbers: list[float] = [v for v in values if isinstance(v, int | float)]
        match d.op:
            case "count":
                return len(values)
            case "rate":
                assert d.over is not None
                return len(values) * SECOND / d.over if now >= begun + d.over else None
            case "sum":
                return _exactly(lambda: math.fsum(numbers))
            case "mean":
                return _exactly(lambda: math.fsum(numbers) / len(numbers)) if numbers else None
            case "min" | "max":
                return (min if d.op == "min" else max)(numbers) if numbers else None
            case "last":
                return values[-1] if values else None
            case "previous":
                return values[0] if len(values) == 2 else None
            case "delta":
                return _known(numbers[1] - numbers[0]) if len(values) == 2 else None
        held = samples[-1][0].time if samples else begun
        return (now - held) / SECOND


def changes(
    definitions: Sequence[Definition], steps: Sequence[Step], limits: Collection[object], begun: int
) -> Iterator[int]:
    """Times at which a derived signal may change by time alone, or an age may pass a limit, and many more."""
    times = {begun, *(s.time for s in steps)}
    widths = {d.over for d in definitions if d.over is not None and not d.counted}
    widths |= {d.forget for d in definitions if d.forget is not None and d.op == "age"}
    widths |= {round(v * SECOND) for v in limits if isinstance(v, int | float) and abs(v) < 100}
    for width in widths:
        for time in times:
            yield from (time + width - 1, time + width, time + width + 1)


def _remembered(
    found: list[tuple[Step, Value]], d: Definition, newest: Step | None, now: int
) -> list[tuple[Step, Value]]:
    """What is not forgotten: all of a key that was heard of lately, and what may have been one."""
    if d.forget is None:
        return found
    known = newest.number if newest is not None and _is_kept(d, newest, now) else 0
    return [(s, v) for s, v in found if s.number <= known or (by_of(d) not in s.seen and _is_kept(d, s, now))]


def _is_kept(d: Definition, step: Step, now: int) -> bool:
    return d.forget is None or step.time + d.forget > now


def _evaluated(text: str, step: Step) -> Value:
    """What one of `EXPRESSIONS` comes to: operand by operand, the first that is absent or fails decides."""
    names = re.findall(r"[a-z]\w*", text)
    values: list[Value] = []
    for name in names:
        value = FAILED if name in step.failed else step.seen.get(name)
        if value is None or isinstance(value, Failed):
            return value
        if "*" in text and isinstance(value, str | bool):
            return FAILED
        values.append(value)
    if text == names[0]:
        return values[0]
    if any(isinstance(v, str | bool) for v in values):
        return FAILED
    one, other, *_ = [v for v in values if isinstance(v, int | float)] * 2
    return _known(one * 2 + other if "*" in text else -one if len(names) == 1 else one - other)


def by_of(d: Definition) -> str:
    """The one signal by which something is kept, empty where there is none, or several."""
    return d.by[0] if len(d.by) == 1 else ""


def _parts(d: Definition, step: Step) -> Parts:
    return tuple(_key(step.seen[by]) if by in step.seen else None for by in d.by)


def _agreeing(made: Mapping[Parts, object], parts: Parts) -> list[Parts]:
    """The keys that agree with the parts that are there, of which one is at least."""
    given = [(i, part) for i, part in enumerate(parts) if part is not None]
    return [key for key in made if given and all(key[i] == part for i, part in given)]


def _exactly(compute: Callable[[], float]) -> Value:
    try:
        return compute()
    except OverflowError:
        return FAILED


def _known(value: float) -> Value:
    return value if (isinstance(value, int) and -(2**63) <= value < 2**64) or (
        isinstance(value, float) and math.isfinite(value)) else FAILED  # fmt: skip


def _key(value: Scalar) -> Key:
    return isinstance(value, bool), value


def _meets(constraint: Constraint, step: Step) -> bool:
    if constraint.key == "topic":
        return constraint.value == step.stream
    if constraint.key in step.failed or constraint.key not in step.seen:
        return False
    if isinstance(constraint.value, Signal):
        return precedes(step.seen[constraint.key], constraint.op, step.seen.get(constraint.value.name))
    return meets(constraint, step.seen[constraint.key])
