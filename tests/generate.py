"""Random formulas and traces by a seed: a hundred times as fast as drawing them with hypothesis; nothing shrinks."""

from __future__ import annotations

import os
import random
from collections.abc import Callable
from functools import reduce

from oracle_server.core.errors import FormulaError
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import needs
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.relations import check_relations
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Ref, Scalar
from tests.brute import TimedSignals
from tests.strategies import CORNERS, SECOND, START, VALUES, free

KEYS = "abc"
JOINED = float(os.environ.get("JOINED", "0.02"))
"""The share of formulas with parts that bind each other's variables."""
RELATED = float(os.environ.get("RELATED", "0.3"))
"""The share of formulas with relations between variables."""
_OPS: tuple[tree.Op, ...] = ("==", "!=", "<", "<=", ">", ">=")
_KINDS = (
    *("not", "and", "or", "implies", "pre", "historically"),
    *("once", "once", "since", "since", "quantifier", "quantifier"),
)
_JOINING = ("and", "and", "and", "order", "order", "unbroken", "unbroken", "sought", "sought")
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


def plain(rng: random.Random, time: Time, depth: int) -> Formula:
    """One of `formula`, or one of `joined`: these take the table thirty times as long."""
    return joined(rng, time, min(depth, 3)) if rng.random() < JOINED else formula(rng, time, depth)


def either(rng: random.Random, time: Time, depth: int) -> Formula:
    """One of `plain`, some with relations between variables."""
    if rng.random() >= RELATED:
        return plain(rng, time, depth)
    return related(rng, plain(rng, time, depth)) if rng.random() < 0.7 else _within(rng, time, depth)


def _within(rng: random.Random, time: Time, depth: int) -> Formula:
    """A closed formula with a quantifier whose relations are about variables that are bound beside it."""
    names = tuple(rng.sample("xyz", rng.choice((2, 2, 3))))
    cut = rng.randint(1, len(names) - 1)
    outer, inner = names[:cut], names[cut:]
    body: Formula = _binding(rng, time, rng.randint(0, 2), rng.choice((inner, inner, names)))
    body = rng.choice((tree.And, tree.And, tree.Implies))(body, _relation(rng, names))
    body = rng.choice((body, body, tree.And(formula(rng, time, 1, 0, names), body), tree.Pre(body)))
    for name in inner:
        body = rng.choice((tree.Exists, tree.Forall))(name, body)
    body = rng.choice((body, body, tree.Not(body), tree.Or(formula(rng, time, 1, 0, outer), body)))
    begun = _binding(rng, time, rng.randint(0, 2), outer)
    ways = (tree.And(begun, body), tree.Implies(begun, body), tree.Or(tree.Not(begun), body), tree.And(body, begun))
    body = rng.choice(ways)
    body = rng.choice((body, body, tree.Pre(body), tree.Once(body, bound(rng, time)), tree.And(begun, tree.Not(body))))
    for name in outer:
        body = rng.choice((tree.Exists, tree.Forall))(name, body)
    return _accepted(rng, body, formula(rng, time, depth))


def related(rng: random.Random, whole: Formula, scope: tuple[str, ...] = ()) -> Formula:
    """The formula with relations between its variables beside some of its parts, where they are accepted."""

    def change(node: Formula, scope: tuple[str, ...]) -> Formula:
        inner = (*scope, node.variable) if isinstance(node, tree.Exists | tree.Forall) else scope
        found = tree.rebuilt(node, lambda part: change(part, inner))
        if not scope or rng.random() > 0.4:
            return found
        known = tuple(sorted(needs(found)))
        if known and rng.random() < 0.6:
            return rng.choice((tree.And, tree.And, tree.Implies))(found, _relation(rng, known))
        added: Formula = _relation(rng, scope)
        for _ in range(rng.choice((0, 0, 1))):
            added = rng.choice((tree.And, tree.Or, tree.Implies))(added, _relation(rng, scope))
        if rng.random() < 0.3:
            added = tree.Not(added)
        sides = (found, added) if rng.random() < 0.7 else (added, found)
        return rng.choice((tree.And, tree.And, tree.Or, tree.Implies))(*sides)

    return _accepted(rng, change(whole, scope), whole)


def _relation(rng: random.Random, scope: tuple[str, ...]) -> tree.Relation:
    left = rng.choice(scope)
    others = [name for name in scope if name != left]
    right = Ref(rng.choice(others)) if others and rng.random() < 0.7 else rng.choice((*VALUES, 2, 2.5, 3))
    return tree.Relation(Ref(left), rng.choice(_OPS), right)


def _accepted(rng: random.Random, changed: Formula, whole: Formula) -> Formula:
    """The formula with an atom beside those of its relations that are refused without one."""
    for _ in range(6):
        try:
            check_relations(changed)
        except FormulaError:
            changed = _bound(rng, changed)
        else:
            return changed
    return whole


def _bound(rng: random.Random, node: Formula) -> Formula:
    if not isinstance(node, tree.Relation):
        return tree.rebuilt(node, lambda part: _bound(rng, part))
    if rng.random() < 0.4:
        return node
    keys = rng.sample(KEYS, len(node.variables))
    refs = [Constraint(key, "==", Ref(name)) for key, name in zip(keys, node.variables, strict=True)]
    binder: Formula = Atom(tuple(refs))
    if len(refs) > 1 and rng.random() < 0.5:
        binder = tree.And(Atom((refs[0],)), tree.Once(Atom((refs[1],))))
    binder = rng.choice((binder, binder, tree.Once(binder), tree.Pre(binder)))
    return rng.choice((tree.And, tree.Implies))(binder, node)


def joined(rng: random.Random, time: Time, depth: int) -> Formula:
    """A closed formula of two variables or three, of which some parts bind some of them, and other parts the others."""
    names = tuple(rng.sample("xyz", rng.choice((2, 2, 2, 3))))
    body = _binding(rng, time, depth, names)
    kinds: tuple[type[tree.Exists | tree.Forall], ...] = (tree.Exists,)
    if rng.random() < 0.5:
        body, kinds = tree.Implies(body, formula(rng, time, rng.randint(0, 2), 1, names)), (tree.Forall,)
    if rng.random() < 0.3:
        kinds = (tree.Exists, tree.Forall)
    for name in names:
        body = rng.choice(kinds)(name, body)
    wrapped = (tree.Not(body), tree.Pre(body), tree.Historically(body, bound(rng, time)), formula(rng, time, 1, 0))
    return rng.choice((*[body] * 7, *wrapped[:3], tree.And(body, wrapped[3])))


def _binding(rng: random.Random, time: Time, depth: int, names: tuple[str, ...]) -> Formula:
    """A part that holds for finitely many values of these variables."""

    def part(some: tuple[str, ...] = names) -> Formula:
        return _binding(rng, time, depth - 1, some)

    if depth <= 0 or rng.random() < 0.1:
        keys = rng.sample(KEYS, len(names)) if len(names) <= len(KEYS) else ()
        return Atom(tuple(Constraint(key, "==", Ref(name)) for key, name in zip(keys, names, strict=True)))
    past = rng.choice((tree.ALL_PAST, tree.ALL_PAST, bound(rng, time)))
    kind = rng.choice((*_JOINING, "but", "or", "pre", "once", "once", "since", "exists"))
    cut = rng.randint(1, max(1, len(names) - 1))
    if kind == "order" and len(names) > 1:
        return _order(rng, time, depth, names[:cut], names[cut:])
    if kind == "sought" and len(names) < 3:
        return tree.And(part(), _sought(rng, time, depth, names))
    shared = tuple(dict.fromkeys((rng.choice(names), *names[cut:])))
    if kind == "unbroken" and len(names) > 1:
        left = tree.Not(part(rng.choice((shared, names[cut:]))))
        return tree.And(part(), tree.Since(left, part(names[:cut]), past))
    if kind == "and" and len(names) > 1:
        sides = [part(names[:cut]), part(shared)]
        rng.shuffle(sides)
        return tree.And(*sides)
    free_part = formula(rng, time, rng.randint(0, 2), 0, names)
    extra = next(name for name in "wxyz" if name not in names)
    made: dict[str, Callable[[], Formula]] = {
        "but": lambda: tree.And(part(), tree.Not(free_part)),
        "or": lambda: tree.Or(part(), part()),
        "pre": lambda: tree.Pre(part()),
        "once": lambda: tree.Once(part(), past),
        "since": lambda: tree.Since(rng.choice((tree.Not(free_part), free_part)), part(), past),
        "exists": lambda: tree.Exists(extra, part((*names, extra))),
    }
    return made[kind]() if kind in made and (kind != "exists" or len(names) < 3) else tree.And(part(), free_part)


def _sought(rng: random.Random, time: Time, depth: int, names: tuple[str, ...]) -> Formula:
    """That for some value, or for all, something was so whenever events had some of these variables: a lockset."""
    extra = next(name for name in "wxyz" if name not in names)

    def kept() -> Formula:
        return _kept(rng, time, tuple(rng.sample(names, rng.randint(1, len(names)))), extra)

    body = rng.choice((tree.And, tree.And, tree.Or))(kept(), kept()) if rng.random() < 0.8 else kept()
    found: Formula = rng.choice((tree.Exists, tree.Exists, tree.Forall))(extra, body)
    return rng.choice((found, tree.Not(found)))


def _kept(rng: random.Random, time: Time, some: tuple[str, ...], extra: str) -> Formula:
    """That something was so, or was not, whenever events had some of these variables."""
    guard = _binding(rng, time, 0, some)
    if rng.random() < 0.5:
        guard = tree.Or(guard, _binding(rng, time, 0, some))
    held = _binding(rng, time, 0, (some[0], extra))
    if rng.random() < 0.5:
        held = tree.Since(tree.Not(_binding(rng, time, 0, (some[0], extra))), held, tree.ALL_PAST)
    past = rng.choice((tree.ALL_PAST, tree.ALL_PAST, bound(rng, time)))
    missed: Formula = tree.Once(tree.And(guard, tree.Not(held)), past)
    always = tree.Historically(tree.Implies(guard, held), past)
    return rng.choice((always, always, tree.Not(missed), missed, tree.Pre(missed)))


def pairs(rng: random.Random, time: Time) -> Formula:
    """That two which are told of the same have something in common, as threads have a lock; or that they have not."""
    one, other, same, extra = rng.sample("wxyz", 4)
    parts = [_kept(rng, time, tuple(rng.sample((name, same), 2)), extra) for name in (one, other)]
    if rng.random() < 0.3:
        parts.append(_kept(rng, time, (rng.choice((one, same)),), extra))
    if rng.random() < 0.2:
        parts.append(tree.Once(_binding(rng, time, 0, rng.choice(((extra,), (one,)))), tree.ALL_PAST))
    rng.shuffle(parts)
    common: Formula = tree.Exists(extra, reduce(tree.And, parts))
    told: list[Formula] = [_binding(rng, time, 0, (name, same)) for name in (one, other)]
    told = [tree.Once(part, tree.ALL_PAST) if rng.random() < 0.85 else part for part in told]
    found: Formula = tree.And(tree.And(*told), common if rng.random() < 0.3 else tree.Not(common))
    for name in rng.sample((one, other, same), 3):
        found = tree.Exists(name, found)
    return found if rng.random() < 0.3 else tree.Not(found)


def _order(rng: random.Random, time: Time, depth: int, last: tuple[str, ...], first: tuple[str, ...]) -> Formula:
    """That something held for some variables when something already had for others, and what else is asked of them."""
    begun: Formula = tree.Once(_binding(rng, time, depth - 2, first), tree.ALL_PAST)
    if rng.random() < 0.7:
        begun = tree.Pre(begun)
    sides = [_binding(rng, time, depth - 2, last), begun]
    rng.shuffle(sides)
    found: Formula = tree.And(*sides)
    if rng.random() < 0.8:
        found = tree.Once(found, tree.ALL_PAST)
    if rng.random() < 0.7:
        found = tree.And(_binding(rng, time, depth - 2, last), found)
    if rng.random() < 0.7:
        other = _binding(rng, time, depth - 2, first)
        before = tree.Pre(tree.Once(other, tree.ALL_PAST))
        found = tree.And(found, rng.choice((other, tree.Not(other), tree.Not(before))))
    return found


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
