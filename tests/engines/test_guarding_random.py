"""What breaks the obligations of guards, against the table read literally, on random cases; some are taken back."""

from __future__ import annotations

import json
import os
import random
from collections import Counter
from collections.abc import Sequence
from itertools import accumulate

import pytest

from oracle_server.core.atoms import Matches, canonical, specialise
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import check_ahead, looks_ahead, obligation
from oracle_server.core.formula.breach import breach
from oracle_server.core.formula.parse import Time, parse_formula
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Ref
from oracle_server.core.lost import lost
from oracle_server.core.plan import View
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native.guarding import GuardingEngine
from tests import generate
from tests.brute import Values
from tests.engines.test_against_brute import SEED
from tests.engines.test_native_back import saved
from tests.engines.test_obligations_random import compared, trace
from tests.obligations import Item, Past
from tests.strategies import START

CASES = int(os.environ.get("CASES", "1500")) // 6


def goal(rng: random.Random, time: Time, depth: int, scope: tuple[str, ...]) -> Formula:
    """What is asked by `always`, with what only looks back beside it."""
    if depth == 0:
        if scope and rng.random() < 0.3:
            return compared(rng, time, scope)
        return generate.formula(rng, time, rng.choice((0, 0, 1, 2)), 1, scope)
    kind = rng.choice(("always", "always", "always", "and", "or", "implies"))
    left = generate.formula(rng, time, rng.choice((0, 1)), 1, scope)
    right = goal(rng, time, depth - 1, scope)
    match kind:
        case "always":
            return tree.Always(right, generate.bound(rng, time))
        case "and":
            return tree.And(goal(rng, time, depth - 1, scope), right)
        case "or":
            return tree.Or(left, right) if rng.random() < 0.5 else tree.Or(right, left)
        case _:
            return tree.Implies(left, right)


def formula(rng: random.Random, time: Time) -> Formula:
    scope = tuple("xy"[: rng.choice((0, 0, 1, 1, 2))])
    body = goal(rng, time, rng.randint(1, 3), scope)
    while not looks_ahead(body):
        body = goal(rng, time, rng.randint(1, 3), scope)
    if not scope and rng.random() < 0.2 and isinstance(body, tree.Always) and body.bound.upper is not None:
        return tree.Always(generate.formula(rng, time, 1), body.bound)
    keys = rng.sample(generate.KEYS, len(scope))
    bind: Formula = Atom(tuple(Constraint(key, "==", Ref(name)) for key, name in zip(keys, scope, strict=True)))
    other = generate.formula(rng, time, rng.randint(0, 2), 1, scope)
    whole: Formula = tree.Implies(rng.choice((bind, tree.And(bind, other), tree.Once(bind))) if scope else other, body)
    for name in reversed(scope):
        whole = tree.Forall(name, whole)
    return whole


def breaks(whole: Formula, items: Sequence[Item], time: Time, keys: Sequence[Values]) -> bool:
    """Whether the last item is a step at which something that is asked for, about any step up to it, does not hold.

    A step that comes after a later tick counts at that time, and one that can't be judged neither asks nor breaks.
    """
    found = obligation(whole)
    assert found is not None
    past, reached = Past(items, time), list(accumulate((item.time for item in items), max))
    at = [reached[n] for n, item in enumerate(items) if item.signals is not None]
    if time == "steps":
        at = list(range(len(at)))
    last = len(at) - 1

    def broken(node: Formula, values: Values, i: int) -> bool:
        if not looks_ahead(node):
            return i == last and past.of(node, values)[i] == "false"
        match node:
            case tree.Always(operand, bound):
                upper = at[last] - at[i] if bound.upper is None else bound.upper
                within = [n for n in range(i, last + 1) if bound.lower <= at[n] - at[i] <= upper]
                return any(broken(operand, values, n) for n in within)
            case tree.And(left, right):
                return broken(left, values, i) or broken(right, values, i)
            case tree.Implies(left, right):
                return past.of(left, values)[i] == "true" and broken(right, values, i)
            case tree.Or(left, right):
                before, ahead = (right, left) if looks_ahead(left) else (left, right)
                return past.of(before, values)[i] == "false" and broken(ahead, values, i)
        raise AssertionError(node)

    return any(
        (found.trigger is None or past.of(found.trigger, values)[i] == "true") and broken(found.goal, values, i)
        for values in keys
        for i in range(len(at))
    )


class Fed:
    """An engine that is fed items."""

    def __init__(self, whole: Formula, time: Time) -> None:
        self._whole, self._time = whole, time
        self.engine = GuardingEngine(whole, time)
        atoms = tree.atoms(whole)
        self._view = View(len(atoms), specialise(atoms, {}, lambda _: True), frozenset(generate.KEYS))

    def feed(self, item: Item) -> bool:
        """Whether nothing was decided false."""
        if item.signals is None:
            self.engine.pass_time(item.time)
            return True
        self.engine.lose(lost(self._view, item.signals, item.failed))
        matches: Matches = self._view.matches(item.signals)
        return self.engine.step(item.time, matches) not in NEGATIVE

    def restart(self) -> None:
        saved = json.loads(json.dumps(self.engine.snapshot()))
        self.engine = GuardingEngine(self._whole, self._time)
        self.engine.restore(saved)


@pytest.mark.parametrize("time", ["steps", "seconds"])
def test_each_step_that_breaks_what_is_asked_by_always_is_told(time: Time) -> None:
    stats = Counter[str]()
    for number in range(SEED, SEED + CASES):
        rng = random.Random(f"guarding {time} {number}")
        whole = formula(rng, time)
        if any(isinstance(node, tree.Or) and all(map(looks_ahead, tree.children(node))) for node in tree.walk(whole)):
            continue
        check_ahead(whole)
        fed, items = Fed(whole, time), list[Item]()
        given = trace(rng, time, rng.randint(2, 8))
        names = found.variables if (found := obligation(whole)) else ()
        distinct = list({canonical(v): v for item in given for v in (item.signals or {}).values()}.values())
        keys: list[Values] = [{}]
        for name in names:
            keys = [{**values, name: v} for values in keys for v in distinct]
        for item in given:
            if rng.random() < 0.3:
                before = saved(fed.engine)
                fed.engine.mark()
                begun = max((i.time for i in items if i.signals is not None), default=given[0].time)
                for other in trace(rng, time, rng.randint(1, 3)):
                    fed.feed(other._replace(time=other.time - START + begun))
                fed.engine.back()
                assert saved(fed.engine) == before, f"case {number}: what is taken back leaves nothing behind"
                stats["taken back"] += 1
            if rng.random() < 0.2:
                fed.restart()
            held, owed = fed.feed(item), fed.engine.owed
            assert owed is not None
            if item.signals is None:
                items += [item] if owed.closed else []  # one that decides nothing leaves nothing behind
                continue
            items.append(item)
            wanted, told = breaks(whole, items, time, keys), f"case {number}: {render(whole, time)}\n{items}"
            if not item.failed:  # else the event is denied anyway
                assert fed.engine.breaks is wanted, told
            assert held or wanted, "what is decided false is broken"
            stats["broken again" if wanted and held else "broken" if wanted else "kept"] += 1
            stats["late"] += any(tick.time > item.time for tick in items)
            stats["failed"] += bool(item.failed)
    print(dict(stats))
    assert min(stats[what] for what in ("broken", "broken again", "kept", "taken back", "failed")) > CASES // 10
    assert (stats["late"] > CASES // 100) is (time == "seconds")


def test_what_fails_for_one_value_is_asked_for_another() -> None:
    whole = parse_formula("forall[x]. {a: *x} or {b: *x, c: 1} -> always[:9] not {d: *x}", "steps")
    fed = Fed(whole, "steps")
    fed.feed(Item(1, {"a": 1, "b": 2}, frozenset({"c"})))
    broken = []
    for value in (1, 1, 2, 3):
        fed.feed(Item(2, {"d": value}, frozenset()))
        broken.append(fed.engine.breaks)
    assert broken == [True, True, False, False], "a second event that breaks it is denied, too"


def test_of_two_always_one_of_which_is_asked_the_past_tells_nothing() -> None:
    both = tree.Or(tree.Always(tree.TRUE), tree.Always(tree.FALSE))
    found = obligation(tree.Implies(tree.TRUE, both))
    assert found is not None
    assert breach(found) is None
