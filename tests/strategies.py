"""Random formulas and traces: few keys and few values, so that they meet, and all corners."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Literal

from hypothesis import strategies as st

from oracle_server.core.formula import tree
from oracle_server.core.formula.tree import Atom, Bound, Constraint, Formula, Scalar

if TYPE_CHECKING:
    from oracle_server.core.formula.parse import Time
    from tests.brute import TimedSignals

Draw = Callable[[st.SearchStrategy[Any]], Any]
Op = Literal["==", "!=", "<", "<=", ">", ">="]

KEYS = ("a", "b")
VALUES: tuple[Scalar, ...] = (7, True, "7", 1, 7.0, False)
NUMBERS: tuple[int | float, ...] = (7, 2.5, 1.0)
CORNERS: list[tuple[int, int | None]] = [
    *((0, None), (0, 0), (1, 1), (2, 2), (3, 3), (1, None), (2, None), (3, None)),
    *((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)),
]
"""The ends of bounds: all of the past, and now, at, from, up to and between small distances."""
SECOND = 10**9
START = 1_700_000_000 * SECOND + 1

_UNARY: dict[str, Callable[[Formula, Bound], Formula]] = {
    "not": lambda operand, _: tree.Not(operand),
    "pre": lambda operand, _: tree.Pre(operand),
    "once": tree.Once,
    "historically": tree.Historically,
}
_BINARY: dict[str, Callable[[Formula, Formula, Bound], Formula]] = {
    "and": lambda left, right, _: tree.And(left, right),
    "or": lambda left, right, _: tree.Or(left, right),
    "implies": lambda left, right, _: tree.Implies(left, right),
    "since": tree.Since,
}
_QUANTIFIERS: dict[str, type[tree.Exists] | type[tree.Forall]] = {
    "exists": tree.Exists,
    "forall": tree.Forall,
}


def bounds(time: Time) -> st.SearchStrategy[Bound]:
    """Bounds at the corners, no bound and [0:0] most often."""
    unit = 1 if time == "steps" else SECOND
    ends = st.sampled_from([*CORNERS[:2] * 3, *CORNERS])
    return ends.map(lambda e: Bound(e[0] * unit, None if e[1] is None else e[1] * unit))


def constraints(scope: tuple[str, ...]) -> st.SearchStrategy[Constraint]:
    """Constraints of every kind over the variables in scope."""
    key = st.sampled_from(KEYS)
    value = st.sampled_from(VALUES)
    equal: st.SearchStrategy[Op] = st.just("==")
    equality: st.SearchStrategy[Op] = st.sampled_from(("==", "!="))
    order: st.SearchStrategy[Op] = st.sampled_from(("<", "<=", ">", ">="))
    kinds = [
        st.builds(Constraint, key, equality, value),
        st.builds(Constraint, key, order, st.sampled_from(NUMBERS)),
        st.builds(Constraint, key, equal, st.just(tree.Any.ANY)),
    ]
    if scope:
        refs = st.builds(tree.Ref, st.sampled_from(scope))
        kinds += [st.builds(Constraint, key, equal, refs)] * 3
    return st.one_of(kinds)


def atoms(scope: tuple[str, ...]) -> st.SearchStrategy[Atom]:
    """Atoms of one to three constraints, the same key or variable possibly in several of them."""
    constraint = constraints(scope)
    one = st.tuples(constraint)
    several = st.lists(constraint, min_size=2, max_size=3).map(tuple)
    return st.one_of(one, one, several).map(Atom)


@st.composite
def formulas(draw: Draw, time: Time = "steps", depth: int = 4, scope: tuple[str, ...] = ()) -> Formula:
    """Formulas with every operator, quantified up to two deep, no quantifier idle; closed but for the scope."""
    return _formula(draw, time, depth, 2 - len(scope), scope)


def _formula(draw: Draw, time: Time, depth: int, quantifiers: int, scope: tuple[str, ...]) -> Formula:
    kinds = ["atom"]
    if depth:
        kinds += ["since", *_UNARY, *_BINARY, *(_QUANTIFIERS if quantifiers else ())]
    kind = draw(st.sampled_from(kinds))
    if kind in _UNARY:
        operand = _formula(draw, time, depth - 1, quantifiers, scope)
        return _UNARY[kind](operand, draw(bounds(time)))
    if kind in _BINARY:
        left = _formula(draw, time, depth - 1, quantifiers, scope)
        right = _formula(draw, time, depth - 1, quantifiers, scope)
        return _BINARY[kind](left, right, draw(bounds(time)))
    if kind in _QUANTIFIERS:
        variable = draw(st.sampled_from(("x", "y")))
        inner = tuple(dict.fromkeys((*scope, variable)))
        body = _formula(draw, time, depth - 1, quantifiers - 1, inner)
        return _QUANTIFIERS[kind](variable, _using(draw, time, variable, body))
    atom: Atom = draw(atoms(scope))
    return atom


def _using(draw: Draw, time: Time, variable: str, body: Formula) -> Formula:
    """The body, joined with a use of the variable where it has none."""
    if variable in free(body):
        return body
    ref = Constraint(draw(st.sampled_from(KEYS)), "==", tree.Ref(variable))
    left, right = draw(st.permutations((body, Atom((ref,)))))
    return _BINARY[draw(st.sampled_from(sorted(_BINARY)))](left, right, draw(bounds(time)))


def free(formula: Formula) -> frozenset[str]:
    """The variables that nothing in a formula binds."""
    if isinstance(formula, Atom):
        return frozenset(name for _, name in formula.refs)
    if isinstance(formula, tree.Relation):
        return frozenset(formula.variables)
    inner = frozenset[str]().union(*(free(child) for child in tree.children(formula)))
    return inner - {formula.variable} if isinstance(formula, tree.Exists | tree.Forall) else inner


def signals() -> st.SearchStrategy[dict[str, Scalar]]:
    """The signals of one step; a key is absent as often as it has any one value."""
    key = st.sampled_from((*VALUES, None))
    present = st.tuples(*(key for _ in KEYS)).map(lambda values: zip(KEYS, values, strict=True))
    return present.map(lambda pairs: {key: value for key, value in pairs if value is not None})


def traces(*, after: int = START, max_size: int = 12) -> st.SearchStrategy[list[TimedSignals]]:
    """Steps whose times never go back: equal, or whole seconds apart or nearly so."""
    gap = st.sampled_from((0, 1, SECOND - 1, SECOND, SECOND + 1, 2 * SECOND))
    step = st.tuples(gap, signals())

    def timed(steps: list[tuple[int, dict[str, Scalar]]]) -> list[TimedSignals]:
        return [(after + sum(g for g, _ in steps[: i + 1]), s) for i, (_, s) in enumerate(steps)]

    def of_length(size: int) -> st.SearchStrategy[list[TimedSignals]]:
        return st.lists(step, min_size=size, max_size=size).map(timed)

    return st.integers(0, max_size).flatmap(of_length)
