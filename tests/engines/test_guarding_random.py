"""What breaks the obligations of guards, against the table read literally, on random cases; some are taken back."""

from __future__ import annotations

import json
import os
import random
from collections import Counter
from collections.abc import Sequence

import pytest

from oracle_server.core.atoms import Matches, canonical, specialise
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import check_ahead, looks_ahead, obligation
from oracle_server.core.formula.breach import breach
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Formula, Ref
from oracle_server.core.plan import View
from oracle_server.core.verdicts import NEGATIVE
from oracle_server.engines.native.guarding import GuardingEngine
from tests import generate
from tests.brute import TimedSignals, Values, truths_for
from tests.engines.test_against_brute import SEED
from tests.engines.test_obligations_random import compared

CASES = int(os.environ.get("CASES", "3000")) // 6


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


def breaks(whole: Formula, steps: Sequence[TimedSignals], time: Time, keys: Sequence[Values]) -> bool:
    """Whether the last step is one at which something that is asked for, about any step up to it, does not hold."""
    found = obligation(whole)
    assert found is not None
    last = len(steps) - 1

    def at(part: Formula, values: Values, i: int) -> bool:
        return truths_for(part, steps, time, values)[i]

    def broken(node: Formula, values: Values, i: int) -> bool:
        if not looks_ahead(node):
            return i == last and not at(node, values, i)
        match node:
            case tree.Always(operand, bound):
                far = [steps[n][0] - steps[i][0] if time == "seconds" else n - i for n in range(len(steps))]
                reached = range(i, last + 1)
                upper = far[last] if bound.upper is None else bound.upper
                within = [n for n in reached if bound.lower <= far[n] <= upper]
                return any(broken(operand, values, n) for n in within)
            case tree.And(left, right):
                return broken(left, values, i) or broken(right, values, i)
            case tree.Implies(left, right):
                return at(left, values, i) and broken(right, values, i)
            case tree.Or(left, right):
                past, ahead = (right, left) if looks_ahead(left) else (left, right)
                return not at(past, values, i) and broken(ahead, values, i)
        raise AssertionError(node)

    return any(
        (found.trigger is None or at(found.trigger, values, i)) and broken(found.goal, values, i)
        for values in keys
        for i in range(len(steps))
    )


class Fed:
    """An engine that is fed steps."""

    def __init__(self, whole: Formula, time: Time) -> None:
        self._whole, self._time = whole, time
        self.engine = GuardingEngine(whole, time)
        atoms = tree.atoms(whole)
        self._view = View(len(atoms), specialise(atoms, {}, lambda _: True), frozenset(generate.KEYS))

    def feed(self, step: TimedSignals) -> bool:
        """Whether nothing was decided false."""
        matches: Matches = self._view.matches(step[1])
        return self.engine.step(step[0], matches) not in NEGATIVE

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
        fed, steps = Fed(whole, time), list[TimedSignals]()
        given: list[TimedSignals] = [(at, {**s, "kind": "topic"}) for at, s in generate.trace(rng, rng.randint(2, 8))]
        names = found.variables if (found := obligation(whole)) else ()
        distinct = list({canonical(v): v for _, signals in given for v in signals.values()}.values())
        keys: list[Values] = [{}]
        for name in names:
            keys = [{**values, name: v} for values in keys for v in distinct]
        for step in given:
            if rng.random() < 0.3:
                fed.engine.mark()
                fed.feed((step[0], {"a": 1, "b": 2, "kind": "topic"}))
                fed.engine.back()
                stats["taken back"] += 1
            if rng.random() < 0.2:
                fed.restart()
            if time == "seconds" and rng.random() < 0.3:
                fed.engine.pass_time(step[0] - 1)
            steps.append(step)
            held, wanted = fed.feed(step), breaks(whole, steps, time, keys)
            assert fed.engine.breaks is wanted, f"case {number}: {render(whole, time)}\n{steps}"
            assert held or wanted, "what is decided false is broken"
            stats["broken again" if wanted and held else "broken" if wanted else "kept"] += 1
    print(dict(stats))
    assert min(stats[what] for what in ("broken", "broken again", "kept", "taken back")) > CASES // 10


def test_of_two_always_one_of_which_is_asked_the_past_tells_nothing() -> None:
    both = tree.Or(tree.Always(tree.TRUE), tree.Always(tree.FALSE))
    found = obligation(tree.Implies(tree.TRUE, both))
    assert found is not None
    assert breach(found) is None
