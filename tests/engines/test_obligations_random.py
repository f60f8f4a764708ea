"""Obligations in the native engine against the table, on thousands of random cases.

    CASES=50000 pytest tests/engines/test_obligations_random.py

is the long run. At random places steps and time are taken back, and the engine is restored from what it saves. A case
is told by its number alone.
"""

from __future__ import annotations

import json
import os
import random
from collections import Counter
from collections.abc import Sequence

import pytest

from oracle_server.core.atoms import Matches, canonical, specialise
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import can_fail, check_ahead, looks_ahead, obligation
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Limit, Ref, Signal
from oracle_server.core.lost import lost
from oracle_server.core.plan import View
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native import NativeEngine, waiting
from oracle_server.engines.native.keys import texts_of
from tests import generate
from tests.brute import Fresh, Values
from tests.engines.test_against_brute import SEED
from tests.engines.test_native_back import saved
from tests.obligations import Item, Past, decisions
from tests.strategies import SECOND

CASES = int(os.environ.get("CASES", "3000"))
_VALUES = {0: "false", 1: "true", 2: "lost"}


def word(rng: random.Random, time: Time, scope: tuple[str, ...]) -> Formula:
    """What has a word of its own."""
    operand = generate.formula(rng, time, rng.randint(0, 1), 1, scope)
    lasted = tree.lasting(operand, generate.bound(rng, time).lower)
    return rng.choice((tree.TRUE, tree.FALSE, tree.FIRST, tree.Not(tree.FIRST), lasted))


def compared(rng: random.Random, time: Time, scope: tuple[str, ...]) -> Formula:
    """What compares with a variable, alone or beside something else."""
    limits = [
        Constraint(rng.choice(generate.KEYS), rng.choice(("<", "<=", ">", ">=")), Limit(rng.choice(scope)))
        for _ in range(rng.choice((1, 1, 1, 2)))
    ]
    more = [Constraint(rng.choice(generate.KEYS), "==", Ref(name)) for name in scope if rng.random() < 0.3]
    atom: Formula = Atom((*limits, *more))
    other = generate.formula(rng, time, rng.randint(0, 1), 1, scope)
    return rng.choice((atom, atom, tree.Not(atom), tree.And(atom, other), tree.Implies(other, atom)))


def beside(rng: random.Random, scope: tuple[str, ...]) -> Formula:
    """What two signals of a step must have in common: one is less than the other, or both bind one variable."""
    one, other = rng.sample(generate.KEYS, 2)
    if scope and rng.random() < 0.5:
        name = rng.choice(scope)
        pair: tuple[Constraint, ...] = Constraint(one, "==", Ref(name)), Constraint(other, "==", Ref(name))
    else:
        compares = Constraint(one, rng.choice(("<", "<=", ">", ">=")), Signal(other))
        pair = compares, *tree.demanded([compares])
    rest = [Constraint(key, "==", 7) for key in generate.KEYS if key not in (one, other)]
    atom = Atom((*pair, *rng.choice((rest, ()))))
    return rng.choice((atom, atom, tree.Not(atom)))


def goal(rng: random.Random, time: Time, depth: int, scope: tuple[str, ...]) -> Formula:
    """What is awaited: all operators, nested, over parts that look back."""
    if depth == 0 or rng.random() < 0.15:
        if rng.random() < 0.15:
            return word(rng, time, scope)
        if scope and rng.random() < 0.25:
            return compared(rng, time, scope)
        if rng.random() < 0.15:
            return beside(rng, scope)
        return generate.formula(rng, time, rng.choice((0, 0, 0, 1, 2)), 1, scope)

    def part() -> Formula:
        return goal(rng, time, depth - 1, scope)

    kind = rng.choice(("eventually", "eventually", "always", "until", "until", "next", "and", "or", "implies"))
    bound = generate.bound(rng, time)
    match kind:
        case "eventually":
            return tree.Eventually(part(), bound)
        case "always":
            return tree.Always(part(), bound)
        case "until":
            return tree.Until(part(), part(), bound)
        case "next":
            return tree.Next(part())
        case "and":
            return tree.And(part(), part())
        case "or":
            return tree.Or(part(), part())
        case _:
            return tree.Implies(generate.formula(rng, time, 1, 1, scope), part())


def formula(rng: random.Random, time: Time) -> Formula:
    scope = tuple("xy"[: rng.choice((0, 0, 1, 1, 1, 2))])
    body = goal(rng, time, rng.randint(1, 3), scope)
    while not looks_ahead(body):
        body = goal(rng, time, rng.randint(1, 3), scope)
    keys = rng.sample(generate.KEYS, len(scope))
    bind = Atom(tuple(Constraint(key, "==", Ref(name)) for key, name in zip(keys, scope, strict=True)))
    trigger = bind if scope and rng.random() < 0.5 else generate.formula(rng, time, rng.randint(0, 2), 1, scope)
    if rng.random() < generate.RELATED:
        trigger = generate.related(rng, trigger, scope)
    if scope and trigger is not bind:
        trigger = rng.choice((tree.And(bind, trigger), tree.Once(bind), tree.And(tree.Pre(bind), trigger)))
    if rng.random() < 0.2:
        trigger = tree.And(trigger, word(rng, time, scope)) if scope else word(rng, time, scope)
    whole: Formula = tree.Implies(trigger, body)
    for name in reversed(scope):
        whole = tree.Forall(name, whole)
    return whole


def trace(rng: random.Random, time: Time, size: int) -> list[Item]:
    """Steps, of which some could not be computed wholly, and ticks, some of them beyond later steps."""
    items: list[Item] = []
    fails = rng.choice((0, 0, 0.1, 0.3))
    for at, signals in generate.trace(rng, size):
        if time == "seconds" and rng.random() < 0.35:
            items.append(Item(at - rng.choice((0, 1, SECOND, -SECOND)), None))
        failed = frozenset(key for key in generate.KEYS if rng.random() < fails)
        known = {key: v for key, v in signals.items() if key not in failed}
        items.append(Item(at, {**known, "kind": "topic"}, failed))
    if time == "seconds" and items and rng.random() < 0.5:
        items.append(Item(items[-1].time + rng.randint(0, 6) * SECOND, None))
    return items


class Fed:
    """An engine that is fed items."""

    def __init__(self, formula: Formula, time: Time) -> None:
        self.engine, self._formula, self._time = NativeEngine(formula, time), formula, time
        atoms = tree.atoms(formula)
        tests = specialise(atoms, {}, lambda _: True)
        self._view = View(len(atoms), tests, frozenset(generate.KEYS))

    def feed(self, item: Item) -> bool:
        """Whether nothing was decided false."""
        owed = self.engine.owed
        assert owed is not None
        if item.signals is None:
            self.engine.pass_time(item.time)
            return not owed.failed
        matches: Matches = self._view.matches(item.signals)
        self.engine.lose(lost(self._view, item.signals, item.failed))
        return self.engine.step(item.time, matches) not in NEGATIVE

    def restart(self) -> None:
        saved = json.loads(json.dumps(self.engine.snapshot()))
        self.engine = NativeEngine(self._formula, self._time)
        self.engine.restore(saved)

    def decided(self, keys: Sequence[Values]) -> dict[tuple[int, int], str]:
        owed = self.engine.owed
        assert owed is not None
        names = {_key(values): k for k, values in enumerate(keys)}
        found = [((each.start[1] - 1, names[texts_of(each.key)]), _VALUES[each.value]) for each in owed.decided]
        assert len(dict(found)) == len(found)
        return dict(found)


def _key(values: Values) -> tuple[str | None, ...]:
    return tuple([canonical(v) for v in values.values() if not isinstance(v, Fresh)])


def check(time: Time, number: int, stats: Counter[str]) -> None:
    rng = random.Random(f"obligations {time} {number}")
    whole = formula(rng, time)
    check_ahead(whole)
    found = obligation(whole)
    assert found is not None
    items = trace(rng, time, rng.randint(2, 11))
    fed, past, done = Fed(whole, time), Past(items, time), dict[tuple[int, int], str]()
    seen = [v for item in items for v in (item.signals or {}).values()]
    distinct = list({canonical(v): v for v in seen}.values())
    keys: list[Values] = [{}]
    for name in found.variables:
        keys = [{**values, name: v} for values in keys for v in distinct]
    unseen: list[int] = []
    """The ticks that decided nothing, which leave nothing behind."""

    def told() -> str:
        return f"case {number}, {time}: {render(whole, time)}\n{items[: n + 1]}"

    for n, item in enumerate(items):
        while rng.random() < 0.3:
            known = saved(fed.engine)
            fed.engine.mark()
            before = [i.time for i in items[:n] if i.signals is not None]
            for other in trace(rng, time, rng.randint(1, 4)):
                fed.feed(other._replace(time=other.time - items[0].time + max(before, default=0)))
            fed.engine.back()
            assert saved(fed.engine) == known, f"what is taken back leaves nothing behind: {told()}"
            stats["taken back"] += 1
        if rng.random() < 0.2:
            fed.restart()
            stats["restarts"] += 1
        holds = fed.feed(item)
        table = decisions(whole, [i for m, i in enumerate(items[: n + 1]) if m not in unseen], time, keys, past=past)
        assert all(table[at] == value for at, value in done.items()), told()
        wanted = {at: value for at, value in table.items() if value != "open" and at not in done}
        assert fed.decided(keys) == wanted, told()
        assert holds is ("false" not in wanted.values()), told()
        owed = fed.engine.owed
        assert owed is not None
        assert owed.pending == sum(value == "open" for value in table.values()), told()
        if not owed.pending:
            assert owed.snapshot()["steps"] == 0, f"nothing counts as open, of which there may be so much: {told()}"
        done |= wanted
        if item.signals is None and not wanted:
            unseen.append(n)
        if not can_fail(found.goal):
            assert "false" not in wanted.values(), told()
            stats["endless"] += len(wanted)
        stats.update(wanted.values())
        stats["at ticks"] += len(wanted) if item.signals is None else 0
        stats["prefixes"] += 1
    if rng.random() < 0.5:
        fed.engine.end()
        table = decisions(whole, [i for m, i in enumerate(items) if m not in unseen], time, keys, ended=True, past=past)
        assert fed.decided(keys) == {at: value for at, value in table.items() if at not in done}, (
            f"case {number}, {time}"
        )
        stats["ends"] += 1


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_each_is_decided_once_and_as_the_table_says(time: Time, monkeypatch: pytest.MonkeyPatch) -> None:
    stats = Counter[str]()
    for number in range(SEED, SEED + CASES):
        monkeypatch.setattr(waiting, "MANY", (1, 2, 256)[number % 3])
        monkeypatch.setattr(waiting, "SPARE", (0, 64)[number % 2])
        check(time, number, stats)
    print(CASES, time, dict(stats))
    assert min(stats[what] for what in ("true", "false", "lost", "taken back", "restarts", "ends", "endless")) > 0
    assert (stats["at ticks"] > 0) is (time == "seconds")


def test_between_two_deadlines_time_alone_decides_nothing() -> None:
    for number in range(SEED, SEED + min(CASES, 1000)):
        rng = random.Random(f"deadlines {number}")
        whole = formula(rng, "seconds")
        fed = Fed(whole, "seconds")
        items = trace(rng, "seconds", rng.randint(2, 8))
        after = 0
        for item in items:
            fed.feed(item)
            after = after if item.signals is None else max(after, item.time)
        owed = fed.engine.owed
        assert owed is not None
        while (deadline := fed.engine.next_deadline(after)) is not None:
            assert deadline > after
            if deadline - 1 > after:
                fed.engine.pass_time(deadline - 1)
                assert not owed.decided, f"case {number}"
            fed.engine.pass_time(deadline)
            after = deadline
        before = owed.pending
        fed.engine.pass_time(after + 1000 * SECOND)
        assert not owed.decided
        assert owed.pending == before


def test_what_is_decided_counts_as_open_no_more(monkeypatch: pytest.MonkeyPatch) -> None:
    """A step that is decided by what is told of the next one takes back what it asks of that."""
    monkeypatch.setattr(waiting, "MAX_OPEN", 6)
    fed = Fed(parse_formula("forall[x]. {a: *x} -> always[:1] next next {b: *x}", "steps"), "steps")
    for n in range(30):
        fed.feed(Item(n, {"a": n} if n % 3 == 0 else {}, frozenset()))
    owed = fed.engine.owed
    assert owed is not None
    assert owed.pending == 0


def test_the_reference_parses_what_it_is_about() -> None:
    assert obligation(parse_formula("forall[x]. {a: *x} -> eventually[:2] {b: *x}")) is not None
