"""Random formulas and traces by a seed: a hundred times as fast as drawing them with hypothesis; nothing shrinks."""

from __future__ import annotations

import random
from collections.abc import Callable

from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Ref, Scalar
from tests.brute import TimedSignals
from tests.strategies import CORNERS, SECOND, START, VALUES, free

KEYS = "abc"
_KINDS = (
    *("not", "and", "or", "implies", "pre", "historically"),
    *("once", "once", "since", "since", "quantifier", "quantifier"),
)
_ALPHABETS: tuple[tuple[Scalar, ...], ...] = ((7, "7", 8), (1, 2, 3, 4), (True, 1, 2))


def formula(rng: random.Random, time: Time, depth: int, quantifiers: int = 3, scope: tuple[str, ...] = ()) -> Formula:
    """A formula with every operator, quantified up to three deep, no quantifier idle; closed but for the scope."""
    if depth == 0 or rng.random() < 0.12:
        return _atom(rng, scope)

    def part(inner: tuple[str, ...] = scope, left: int = quantifiers) -> Formula:
        return formula(rng, time, depth - 1, left, inner)

    kind = rng.choice(_KINDS)
    simple: dict[str, Callable[[], Formula]] = {
        "not": lambda: tree.Not(part()),
        "and": lambda: tree.And(part(), part()),
        "or": lambda: tree.Or(part(), part()),
        "implies": lambda: tree.Implies(part(), part()),
        "pre": lambda: tree.Pre(part()),
        "once": lambda: tree.Once(part(), bound(rng, time)),
        "historically": lambda: tree.Historically(part(), bound(rng, time)),
        "since": lambda: tree.Since(part(), part(), bound(rng, time)),
    }
    if kind in simple:
        return simple[kind]()
    if quantifiers == 0:
        return tree.Or(part(), part())
    variable = rng.choice("xyz")
    body = part(tuple(dict.fromkeys((*scope, variable))), quantifiers - 1)
    if variable not in free(body):
        use = Atom((Constraint(rng.choice(KEYS), "==", Ref(variable)),))
        body = tree.And(use, body) if rng.random() < 0.5 else tree.Or(body, use)
    return rng.choice((tree.Exists, tree.Forall))(variable, body)


def trace(rng: random.Random, size: int) -> list[TimedSignals]:
    """Steps of few values, at equal times, or whole seconds apart or nearly so."""
    now, values = START, rng.choice(_ALPHABETS)
    steps: list[TimedSignals] = []
    for _ in range(size):
        now += rng.choice((0, 1, SECOND - 1, SECOND, SECOND + 1, 2 * SECOND, 3 * SECOND))
        steps.append((now, {key: rng.choice(values) for key in KEYS if rng.random() < 0.6}))
    return steps


def _atom(rng: random.Random, scope: tuple[str, ...]) -> Atom:
    return Atom(tuple(_constraint(rng, scope) for _ in range(rng.choice((1, 1, 2)))))


def _constraint(rng: random.Random, scope: tuple[str, ...]) -> Constraint:
    key = rng.choice(KEYS)
    if scope and rng.random() < 0.75:
        return Constraint(key, "==", Ref(rng.choice(scope)))
    value: Scalar | tree.Any = rng.choice((*VALUES, tree.Any.ANY))
    return Constraint(key, "!=" if not isinstance(value, tree.Any) and rng.random() < 0.2 else "==", value)


def bound(rng: random.Random, time: Time) -> Bound:
    unit = 1 if time == "steps" else SECOND
    lower, upper = rng.choice([*CORNERS[:2] * 3, *CORNERS])
    return Bound(lower * unit, None if upper is None else upper * unit)
