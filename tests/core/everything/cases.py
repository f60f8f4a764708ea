"""Random specs with all that one can say together, and what monitors do; a unit of time is a nanosecond."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import msgspec

from oracle_server.core.derived.compared import uncompared
from oracle_server.core.derived.definition import Definition
from oracle_server.core.errors import FormulaError
from oracle_server.core.events import Event
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import check_ahead, looks_ahead
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.relations import check_relations
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Ref
from oracle_server.core.spec import Ordering, Property, Spec, StreamSpec
from tests import generate
from tests.core.derived.cases import definition_of
from tests.engines.test_obligations_random import goal, word
from tests.strategies import SECOND

START = 1_000
SIGNALS = {"/a": ("x", "k"), "/b": ("y", "z", "k"), "/c": ("k", "h"), "/u": ("x", "z")}
DATA: tuple[Any, ...] = (1, 2, 3, 1, 2, 3, 2.5, "w", True)
ACTS = ("clock", "clock", "saved", "again", "leave")


class Sent(NamedTuple):
    """What is done, when, and the event that comes then."""

    now: int
    what: str
    event: Event | None = None


class Case(NamedTuple):
    """A spec, and what is done."""

    spec: Spec
    script: list[Sent]


def case(rng: random.Random) -> Case:
    """A random case that `check` accepts."""
    while True:
        given, derive = _streams(rng), _definitions(rng)
        ordering = Ordering(
            by=rng.choice(("publication", "publication", "arrival", "both")),
            max_delay=rng.choice((5, 5, 0, None, 20)),
            late=rng.choice(("judge", "judge", "skip")),
            max_skew=rng.choice((3, 1_000)),
            capacity=rng.choice((3, 1_000, 1_000)),
        )
        found = _properties(rng, given, derive)
        spec = Spec("s", given, found, ordering, derive=derive, gap=rng.choice((1, 4, 10)))
        if _accepted(spec):
            return Case(spec, _script(rng, spec))


def _accepted(spec: Spec) -> bool:
    try:
        for prop in spec.properties:
            check_relations(prop.formula)
            if looks_ahead(prop.formula):
                check_ahead(prop.formula)
    except FormulaError:
        return False
    return not [*uncompared(spec)]


def _streams(rng: random.Random) -> tuple[StreamSpec, ...]:
    """Streams of which some have rows, some hold, some are filtered; one has no order."""
    found = []
    for name, signals in SIGNALS.items():
        each = "msg.rows" if name == "/c" and rng.random() < 0.6 else None
        of = "item" if each else "msg"
        held = {"/b": {"y"}, "/c": {"h"}, "/a": {"x"} if rng.random() < 0.3 else set()}.get(name, set())
        filtered = not each and rng.random() < 0.5
        found.append(
            StreamSpec(
                name,
                signals={s: f"{of}.{s}" for s in signals},
                hold=frozenset(held),
                each=each,
                ordered=name != "/u",
                latency=0,
                action="filter" if filtered else "log",
                on_deny="undo" if filtered and rng.random() < 0.6 else "keep",
            )
        )
    return tuple(found)


def _definitions(rng: random.Random) -> tuple[Definition, ...]:
    """Derived signals of any kind, machines rather than others in some cases."""
    found: list[Definition] = []
    for n in range(rng.randint(0, 3)):
        drawn = [definition_of(rng, f"d{n}", found) for _ in range(rng.choice((1, 1, 8)))]
        d = max(drawn, key=lambda d: d.table is not None)
        over = d.over if d.over is None or d.counted else rng.randint(1, 8)
        lasts = d.forget is None or (d.table is not None and rng.random() < 0.6)
        found.append(replace(d, over=over, forget=None if lasts else rng.choice((1, 3, 9))))
    return tuple(found)


def _properties(
    rng: random.Random, given: tuple[StreamSpec, ...], derive: tuple[Definition, ...]
) -> tuple[Property, ...]:
    made = []
    filtered = [s.name for s in given if s.action == "filter"]
    for n in range(rng.randint(1, 3)):
        time: Time = rng.choice(("steps", "seconds"))
        formulas = Formulas(rng, derive, time)
        owes = rng.random() < 0.3
        formula = formulas.owing() if owes else formulas.past(rng.randint(0, 3))
        if not owes and time == "seconds" and rng.random() < 0.15:
            formula = tree.Once(formula, Bound(0, rng.randint(1, 9)))
        guards = frozenset[str]() if owes else frozenset(rng.sample(filtered, rng.randint(0, len(filtered))))
        undoes = bool(guards) and all(s.on_deny == "undo" for s in given if s.name in guards)
        made.append(
            Property(
                f"p{n}",
                formula,
                render(formula, time),
                time=time,
                guards=guards,
                blame=rng.choice(("any", "caused")) if undoes else "any",
                latch=not undoes and rng.random() < 0.15,
                at_end=rng.choice(("ignore", "violated")) if owes else "ignore",
            )
        )
    return tuple(made)


class Formulas:
    """Formulas over signals of streams, held and derived ones."""

    def __init__(self, rng: random.Random, derive: tuple[Definition, ...], time: Time) -> None:
        self._rng, self._time = rng, time
        self._known: Mapping[str, Definition] = {d.name: d for d in derive}
        plain = ["x", "y", "z", "k", "h"]
        self._pool = [*rng.sample(plain, 2), *(self._known or plain), *(self._known or plain)]

    def past(self, depth: int) -> Formula:
        """One that looks back."""
        rng, time = self._rng, self._time
        if rng.random() < 0.1:
            return self._over(generate.related(rng, generate.formula(rng, time, min(depth, 2), 2)))
        formula = generate.formula(rng, time, depth, 1)
        if rng.random() < 0.15:
            formula = rng.choice((tree.And, tree.Or, tree.Implies))(formula, word(rng, time, ()))
        return self._over(formula)

    def owing(self) -> Formula:
        """One that waits for what comes."""
        rng, time = self._rng, self._time
        scope = rng.choice(((), (), ("x",)))
        body = goal(rng, time, rng.randint(1, 2), scope)
        while not looks_ahead(body):
            body = goal(rng, time, rng.randint(1, 2), scope)
        bind: Formula = Atom((Constraint("a", "==", Ref("x")),)) if scope else generate.formula(rng, time, 1, 0)
        whole: Formula = tree.Implies(bind, body)
        for name in scope:
            whole = tree.Forall(name, whole)
        return self._over(whole)

    def _over(self, formula: Formula) -> Formula:
        keys = {key: self._rng.choice(self._pool) for key in generate.KEYS}

        def change(node: Formula) -> Formula:
            if isinstance(node, Atom):
                return self._atom(node, keys)
            node = tree.rebuilt(node, change)
            found = getattr(node, "bound", None)
            if not isinstance(found, Bound) or self._time == "steps":
                return node
            upper = None if found.upper is None else found.upper // SECOND
            return replace(node, bound=Bound(found.lower // SECOND, upper))  # type: ignore[arg-type] # those with bounds

        return change(formula)

    def _atom(self, atom: Atom, keys: Mapping[str, str]) -> Atom:
        made = [self._constraint(c, keys[c.key]) if c.key in keys else c for c in atom.constraints]
        if self._rng.random() < 0.25:
            made.insert(0, Constraint("topic", "==", self._rng.choice(tuple(SIGNALS))))
        return Atom(tuple(made))

    def _constraint(self, c: Constraint, name: str) -> Constraint:
        rng, d = self._rng, self._known.get(name)
        if isinstance(c.value, Ref | tree.Limit):
            moves = d is not None and d.op in ("age", "rate")
            return Constraint(rng.choice(("k", "x")) if moves else name, c.op, c.value)
        if isinstance(c.value, tree.Any):
            return Constraint(name, c.op, c.value)
        compares: Callable[[], Any] = lambda: rng.choice(("<", "<=", ">", ">="))  # noqa: E731 -- drawn where wanted
        if d is not None and d.table is not None:
            return Constraint(name, rng.choice(("==", "==", "!=")), rng.choice([v for v in d.table.values if v]))
        if d is not None and d.op == "age":
            return Constraint(name, compares(), rng.randint(1, 9) / SECOND)
        if d is not None and d.op == "rate":
            return Constraint(name, compares(), rng.choice((0, 1, 2)) * SECOND / (d.over or 1))
        value: Any = rng.choice((1, 2, 3, 1.5, "w", "u") if d is None else (0, 1, 2, 3, 1.5, 6))
        return Constraint(
            name, rng.choice(("==", "!=") if isinstance(value, str) else ("==", "==", "<", ">=", "!=")), value
        )


def _data_of(rng: random.Random, names: tuple[str, ...]) -> dict[str, Any]:
    """A message with some of these signals; some fail."""
    made: dict[str, Any] = {}
    for name in names:
        if rng.random() < 0.15:
            continue
        value = rng.choice(("u", "v")) if name == "k" else rng.choice(DATA)
        made[name] = {} if rng.random() < 0.06 else value
    return made


def _script(rng: random.Random, spec: Spec) -> list[Sent]:
    at, sent = START, []
    for _ in range(rng.randint(2, 11)):
        at += rng.choice((0, 1, 1, 2, 3, 7))
        stream = rng.choice(spec.streams)
        arrived = at + rng.choice((0, 0, 0, 1, 3, 8, 15))
        names = tuple(stream.signals or ())
        data: dict[str, Any] = _data_of(rng, names)
        if stream.each:
            rows = [_data_of(rng, names) for _ in range(rng.choice((0, 1, 2, 3)))]
            data = {"rows": 7 if rng.random() < 0.05 else rows}
        stamp = None if rng.random() < 0.05 else at + (rng.choice((5, 30)) if rng.random() < 0.04 else 0)
        ask = stream.action == "filter" and rng.random() < 0.8
        lost = 2 if rng.random() < 0.03 else 0
        sent.append(Event(stream.key, rng.choice("mn"), 0, stamp, arrived, data, ask=ask, lost=lost))
    found, seqs = list[Sent](), Counter[str]()
    for event in sorted(sent, key=lambda event: event.arrived):
        seqs[event.monitor] += 1
        found.append(Sent(event.arrived, "event", msgspec.structs.replace(event, seq=seqs[event.monitor])))
        if rng.random() < 0.3:
            found.append(Sent(event.arrived, rng.choice(ACTS)))
    return found
