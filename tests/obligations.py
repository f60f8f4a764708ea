"""The table of obligations read literally over a prefix: slow, plain, and what the engine is compared with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import accumulate
from typing import Literal, NamedTuple

from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import looks_ahead, obligation
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Atom, Bound, Formula, Scalar
from tests.brute import Fresh, Values, meets, truths_for

Value = Literal["true", "false", "lost", "open"]
Key = tuple[tuple[str, type, Scalar | Fresh], ...]
"""Values of variables, told apart by their types: True and 1 are equal in Python."""
_TURNED: dict[Value, Value] = {"true": "false", "false": "true", "lost": "lost", "open": "open"}


class Item(NamedTuple):
    """A step with its signals and the names of those that failed, or a tick, where `signals` is None."""

    time: int
    signals: Mapping[str, Scalar] | None
    failed: frozenset[str] = frozenset()


class Past:
    """What parts that only look back are at each of some steps: what comes later changes none of it."""

    def __init__(self, items: Iterable[Item], time: Time) -> None:
        self._steps, self._time = [item for item in items if item.signals is not None], time
        self._known: dict[tuple[int, Key], tuple[Formula, list[Value]]] = {}
        """By the part itself, which is kept so that no other one has its number: to compare parts takes long."""
        self._looks_back: dict[int, tuple[Formula, bool]] = {}

    def looks_back(self, formula: Formula) -> bool:
        """Whether a part looks back alone."""
        if id(formula) not in self._looks_back:
            self._looks_back[id(formula)] = formula, not looks_ahead(formula)
        return self._looks_back[id(formula)][1]

    def of(self, formula: Formula, values: Values) -> list[Value]:
        """Lost where an atom of the part can't be judged."""
        key = (id(formula), tuple([(name, type(value), value) for name, value in values.items()]))
        if key not in self._known:
            held = truths_for(formula, [(s.time, s.signals or {}) for s in self._steps], self._time, values)
            atoms = _atoms(formula)
            lost = [any(_fails(atom, s, bound, values) for atom, bound in atoms) for s in self._steps]
            told = zip(held, lost, strict=True)
            self._known[key] = formula, ["lost" if gone else "true" if h else "false" for h, gone in told]
        return self._known[key][1]


def decisions(
    formula: Formula,
    items: Sequence[Item],
    time: Time,
    keys: Sequence[Values],
    *,
    ended: bool = False,
    past: Past | None = None,
) -> dict[tuple[int, int], Value]:
    """What is known of each obligation after some items: by the number of its step and of its values among `keys`.

    `past` may have been made of more items, and spares computing again what is asked of several prefixes.
    """
    found = obligation(formula)
    assert found is not None
    steps = [(n, item) for n, item in enumerate(items) if item.signals is not None]
    reached = list(accumulate((item.time for item in items), max))
    known: dict[tuple[int, int], Value] = {}
    past = past or Past(items, time)
    for k, values in enumerate(keys):
        table = _Table([i for _, i in steps], [n for n, _ in steps], reached, time, values, ended, past)
        asked = table.past(found.trigger) if found.trigger else ["true"] * len(steps)
        answers = table.about(found.goal)
        known |= {(i, k): answers(i) for i in range(len(steps)) if asked[i] == "true"}
    return known


def _all(values: Sequence[Value]) -> Value:
    return next((v for v in ("false", "open", "lost") if v in values), "true")


def _any(values: Sequence[Value]) -> Value:
    return _TURNED[_all([_TURNED[v] for v in values])]


class _Table(NamedTuple):
    steps: list[Item]
    places: list[int]
    reached: list[int]
    """When each item is, ticks too: a step that comes when time has gone on further is one at that time."""
    time: Time
    values: Values
    ended: bool
    known: Past

    def past(self, formula: Formula) -> list[Value]:
        """Of a part that only looks back."""
        return self.known.of(formula, self.values)[: len(self.steps)]

    def about(self, node: Formula) -> Callable[[int], Value]:
        """What is known of a part about each step."""
        if self.known.looks_back(node):
            return self.past(node).__getitem__
        parts = [self.about(child) for child in tree.children(node)]
        memo: dict[int, Value] = {}

        def found(i: int) -> Value:
            if i not in memo:
                memo[i] = self._value(node, parts, i)
            return memo[i]

        return found

    def _value(self, node: Formula, parts: Sequence[Callable[[int], Value]], i: int) -> Value:
        match node:
            case tree.And():
                return _all([part(i) for part in parts])
            case tree.Or():
                return _any([part(i) for part in parts])
            case tree.Implies():
                return _any([_TURNED[parts[0](i)], parts[1](i)])
            case tree.Next():
                return parts[0](i + 1) if i + 1 < len(self.steps) else "false" if self.ended else "open"
            case tree.Eventually(_, b):
                return _any([*(parts[0](j) for j in self._within(i, b)), self._rest(i, b)])
            case tree.Always(_, b):
                return _all([*(parts[0](j) for j in self._within(i, b)), _TURNED[self._rest(i, b)]])
            case tree.Until(_, _, b):
                return self._until(i, b, parts[0], parts[1])
        raise AssertionError(node)

    def _until(self, i: int, b: Bound, left: Callable[[int], Value], right: Callable[[int], Value]) -> Value:
        ways = [_all([right(j), *(left(k) for k in range(i, j))]) for j in self._within(i, b)]
        return _any([*ways, _all([self._rest(i, b), *(left(k) for k in range(i, len(self.steps)))])])

    def _within(self, i: int, b: Bound) -> list[int]:
        at = [n if self.time == "steps" else self.reached[place] for n, place in enumerate(self.places)]
        return [
            j for j in range(i, len(at)) if b.lower <= at[j] - at[i] and (b.upper is None or at[j] - at[i] <= b.upper)
        ]

    def _rest(self, i: int, b: Bound) -> Value:
        """False where nothing that comes can be within a bound: what has come later than it, with a step or without."""
        if self.ended:
            return "false"
        if b.upper is None:
            return "open"
        if self.time == "steps":
            return "false" if len(self.steps) - 1 >= i + b.upper else "open"
        return "false" if self.reached[-1] > self.reached[self.places[i]] + b.upper else "open"


def _fails(atom: Atom, step: Item, bound: frozenset[str], values: Values) -> bool:
    """Whether an atom can't be judged: it reads what failed, and all else of it is met."""
    known = step.signals or {}
    rest = [c for c in atom.constraints if step.failed.isdisjoint(_read(c))]
    free = [c for c in rest if not (isinstance(c.value, tree.Ref) and c.value.name in bound)]
    there = all(c.key in known for c in atom.constraints if c.key not in step.failed)
    met = there and all(meets(c, known, values) for c in free) and _agree([c for c in rest if c not in free], known)
    compared = {key for c in atom.constraints if isinstance(c.value, tree.Signal) for key in _read(c)}
    numbers = not any(isinstance(known[key], str | bool) for key in compared if key in known)
    return met and numbers and len(rest) < len(atom.constraints)


def _agree(refs: Sequence[tree.Constraint], signals: Mapping[str, Scalar]) -> bool:
    """Whether one value of each variable meets all that binds it."""
    found = {(c.value, type(signals[c.key]) is bool, signals[c.key]) for c in refs}
    return len(found) == len({c.value for c in refs})


def _read(constraint: tree.Constraint) -> list[str]:
    """The signals that a constraint reads."""
    value = constraint.value
    return [constraint.key, *([value.name] if isinstance(value, tree.Signal) else [])]


def _atoms(formula: Formula, bound: frozenset[str] = frozenset()) -> list[tuple[Atom, frozenset[str]]]:
    """The atoms of a part, each with the variables that it binds itself."""
    if isinstance(formula, Atom):
        return [(formula, bound)]
    inner = bound | {formula.variable} if isinstance(formula, tree.Exists | tree.Forall) else bound
    return [each for child in tree.children(formula) for each in _atoms(child, inner)]
