"""Relations of which `check` says that they never hold, or always do: each is so on random traces."""

from __future__ import annotations

import os
import random
from dataclasses import replace
from itertools import product

from oracle_server.core.atoms import precedes, same
from oracle_server.core.formula import tree
from oracle_server.core.formula.render import render
from oracle_server.core.formula.tree import Atom, Constraint, Ref, Relation, Scalar
from oracle_server.core.hazards.misfits import Doubt
from oracle_server.core.hazards.places import places
from oracle_server.core.hazards.unrelated import unrelated
from tests import generate
from tests.brute import TimedSignals, truths
from tests.core.test_vacuity import opened, some_spec, some_trace

CASES = int(os.environ.get("CASES", "700"))
OPS: tuple[tree.Op, ...] = ("<", "<=", ">", ">=", "==", "!=")


def some_relation(rng: random.Random) -> tree.Formula:
    """A relation of one variable or two, and what binds them."""
    one, other = (Atom((Constraint(rng.choice(generate.KEYS), "==", Ref(name)),)) for name in "xy")
    if rng.random() < 0.5:
        value = rng.choice((-129, 0, 1, 255, 256, 7.5, "A", True))
        ops = OPS if isinstance(value, int | float) and value is not True else OPS[4:]
        relation: tree.Formula = Relation(Ref("x"), rng.choice(ops), value)
        if rng.random() < 0.5:
            relation = tree.And(relation, Relation(Ref("x"), rng.choice(OPS), rng.choice((0, 1, 7.5, 255, -129))))
        return tree.Forall("x", tree.Implies(one, relation))
    related: tree.Formula = Relation(Ref("x"), rng.choice(OPS), Ref("y"))
    if rng.random() < 0.5:
        sides = [Ref("x"), Ref("y")]
        rng.shuffle(sides)
        related = tree.And(related, Relation(sides[0], rng.choice(OPS), sides[1]))
    return tree.Forall("x", tree.Forall("y", tree.Implies(tree.And(one, tree.Once(other)), related)))


def holds(relation: tree.Formula, values: dict[str, Scalar]) -> bool:
    """Whether it does for these values of variables, or both of two."""
    if isinstance(relation, tree.And):
        return holds(relation.left, values) and holds(relation.right, values)
    assert isinstance(relation, Relation)
    left, right = (values[side.name] if isinstance(side, Ref) else side for side in (relation.left, relation.right))
    if relation.op in ("==", "!="):
        return same(left, right) is (relation.op == "==")
    return precedes(left, relation.op, right)


def bound(formula: tree.Formula, steps: list[TimedSignals]) -> dict[str, list[Scalar]]:
    """The values to which each variable is bound on a trace."""
    found: dict[str, list[Scalar]] = {"x": [], "y": []}
    for atom in tree.atoms(formula):
        there = truths(opened(atom), steps, "steps")
        for key, name in atom.refs:
            found[name] += [signals[key] for (_, signals), here in zip(steps, there, strict=True) if here]
    return found


def test_what_is_warned_of_is_so() -> None:
    told = {"related": 0, "unrelated": 0, "both": 0}
    for number in range(CASES):
        rng = random.Random(f"related {number}")
        spec, types = some_spec(rng, "steps")
        (prop,) = spec.properties
        formula = some_relation(rng)
        spec = replace(spec, properties=(replace(prop, formula=formula),))
        found: list[Doubt] = list(unrelated(formula, places(spec, "steps", types)))
        for doubt in found:
            two = isinstance(doubt.part, tree.And)
            told["both" if two else doubt.claim] += 1
            relation = doubt.part.left if isinstance(doubt.part, tree.And) else doubt.part
            assert isinstance(relation, Relation)
            names = relation.variables
            for _ in range(4):
                values = bound(formula, some_trace(rng, spec, types, 12)[0])
                for chosen in product(*(values[name] for name in names)):
                    right = holds(doubt.part, dict(zip(names, chosen, strict=True)))
                    assert right is (doubt.claim == "related"), f"{number}: {render(formula)}: {chosen}"
    assert min(told.values()) > CASES / 50, told
