"""Whether a part of the formula held at a past step, computed from the remembered steps since.

The engine keeps no more than later verdicts depend on; here the formula table is read literally, but only where an
explanation looks, and with `None` for what is not known any more.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Collection, Iterator, Sequence
from itertools import product

from oracle_server.core.atoms import Matches
from oracle_server.core.formula import tree
from oracle_server.core.formula.ahead import Path
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Bound, Formula
from oracle_server.core.past import Past, Seen
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.ever import Ever
from oracle_server.engines.native.keys import Text, key_of
from oracle_server.engines.native.parts import Part

Tri = bool | None
"""None: not known."""
_MOST_BINDINGS = 200
_WORK = 10
"""What working out a value costs, where looking one up costs 1."""


class Recall:
    """The values of parts at the remembered steps, `first` to `last`; steps are identified by their numbers."""

    def __init__(self, formula: Formula, network: Network, time: Time, last: int, past: Past) -> None:
        self._network, self._past, self._effort = network, past, past.effort
        self._timed = time == "seconds"
        self.noun = past.noun
        self.last = last
        self.first = last - max(len(past.times), 1) + 1
        self._times: Sequence[int] = past.times or (network.timeline.now,)
        self._places = {atom: i for i, atom in enumerate(tree.atoms(formula))}
        self._known: dict[tuple[Path, int, tuple[Text, ...]], Tri] = {}
        self._free: dict[Path, tuple[int, ...]] = {}
        self._texts: dict[str, set[str]] | None = None
        self._seen: dict[int, Matches] = {}

    @property
    def spent(self) -> int:
        """What was spent of the effort."""
        return self._past.effort - self._effort

    def time(self, step: int) -> int:
        """A step's time as explanations show it: its number or, with `time: seconds`, nanoseconds."""
        return self._times[step - self.first] if self._timed else step

    def steps(self, time: int) -> Sequence[int]:
        """The remembered steps at a time, the last one first."""
        if not self._timed:
            return [time] if self.first <= time <= self.last else []
        begin, end = bisect_left(self._times, time), bisect_right(self._times, time)
        return range(end - 1 + self.first, begin - 1 + self.first, -1)

    def seen(self, step: int) -> Seen | None:
        """A remembered step as the session names it, None where it is not remembered."""
        known = self._past.seen is not None and self.first <= step < self.first + len(self._past.times)
        return self._past.seen(step - self.first) if known and self._past.seen is not None else None

    def before(self, bound: Bound) -> int | None:
        """The last step before the window of a bound as of now, 0 for none; None where it is not remembered."""
        window, complete = self.window(bound, self.last)
        return window.start - 1 if complete and (self.first == 1 or window.start > self.first) else None

    def within(self, first: int, last: int) -> int:
        """How many remembered steps there are from one time to another."""
        if self._timed:
            return bisect_right(self._times, last) - bisect_left(self._times, first)
        return max(0, min(last, self.last) - max(first, self.first) + 1)

    def after(self, bound: Bound) -> range:
        """The steps after the window of a bound as of now; the last one alone where some are not remembered."""
        window, _ = self.window(bound, self.last)
        known = self.first == 1 or window.stop > self.first or (not self._timed and window.stop == self.first)
        return range(window.stop if known else self.last, self.last + 1)

    def latest(self, part: Part, upto: int) -> int | None:
        """The last step up to this one at which a part held, 0 for none; None where that is not remembered."""
        for step in range(upto, self.first - 1, -1):
            if not self.spend():
                return None
            if self.at(part, step) is True:
                return step
        return 0 if self.first == 1 else None

    def spend(self) -> bool:
        """Spend effort on what is not needed; false where only what is needed may be spent any more."""
        self._effort -= _WORK
        return self._effort * 2 > self._past.effort

    def window(self, bound: Bound, step: int) -> tuple[range, bool]:
        """The remembered steps whose distance from a step lies in a bound, and whether these are all there were."""
        now = self.time(step)
        farthest = None if bound.upper is None else now - bound.upper
        if not self._timed:
            low, high = 1 if farthest is None else max(1, farthest), now - bound.lower
            return range(max(low, self.first), high + 1), low >= self.first or high < low
        low = 0 if farthest is None else bisect_left(self._times, farthest)
        high = min(bisect_right(self._times, now - bound.lower) - 1, step - self.first)
        return range(low + self.first, high + self.first + 1), self.first == 1 or low > 0

    def at(self, part: Part, step: int) -> Tri:
        """Whether a part held at a step."""
        if step == self.last:
            return self._work_out(part, step)
        if self._effort <= 0:
            return None
        key = (part.path, step, tuple([part.values.get(v) for v in self._variables(part)]))
        self._effort -= 1
        if key not in self._known:
            self._effort -= _WORK
            self._known[key] = self._work_out(part, step)
        return self._known[key]

    def are(self, part: Part, holds: bool, steps: Collection[int]) -> bool:
        """Whether a part is known to have held at all of some steps, or at none; not known where these are too many."""
        return len(steps) * 2 * _WORK <= self._effort and all(self.at(part, step) is holds for step in steps)

    def bindings(self, part: Part) -> list[Part] | None:
        """A quantifier's body with each remembered value, and any other; None where these are too many."""
        if self._texts is None:
            self._texts = self._collect()
        body = part.body(self._network)
        names = [name for name, number in body.scope.items() if part.scope.get(name) != number]
        choices = [[*sorted(self._texts.get(name, ())), None] for name in names]
        size = 1
        for texts in choices:
            size *= len(texts)
        if size > _MOST_BINDINGS:
            return None
        return [body.given(dict(zip([body.scope[n] for n in names], t, strict=True))) for t in product(*choices)]

    def since(self, left: Part, right: Part, bound: Bound, step: int) -> int | None:
        """The latest step that makes `since` hold at a step, None where none is known to."""
        window, _ = self.window(bound, step)
        for j in range(step, window.start - 1, -1):
            if j in window and self.at(right, j) is True:
                return j
            if self.at(left, j) is not True:
                return None
        return None

    def _work_out(self, part: Part, step: int) -> Tri:  # noqa: PLR0911 -- a case a node
        match part.formula:
            case tree.Not(operand):
                return _negated(self.at(part.child(operand), step))
            case tree.And(left, right):
                return _all(iter((self.at(part.child(left), step), self.at(part.child(right, 1), step))))
            case tree.Or(left, right):
                return _any(self.at(p, step) for p in (part.child(left), part.child(right, 1)))
            case tree.Implies(left, right):
                sides = _negated(self.at(part.child(left), step)), self.at(part.child(right, 1), step)
                return _any(iter(sides))
            case tree.Relation():
                return self._related(part)
        if step == self.last:
            return self._now(part)
        return None if step < self.first else self._before(part, step)

    def _now(self, part: Part) -> Tri:
        node = self._network.places.get(part.path)
        if node is None:  # a quantifier whose variables no node uses
            return self.at(part.body(self._network), self.last)
        value = node.at(key_of([part.values.get(v) for v in node.variables]))
        beside = self._network.beside.get(part.path)
        if (
            beside is not None
            and not value
            and not beside.at[0](key_of([part.values.get(v) for v in beside.variables]))
        ):
            return None
        return not value if isinstance(part.formula, tree.Historically | tree.Forall) else value

    def _related(self, part: Part) -> Tri:
        """Whether a relation holds, at whichever step."""
        node = self._network.places[part.path]
        return node.settled(key_of([part.values.get(v) for v in node.variables]))

    def _before(self, part: Part, step: int) -> Tri:  # noqa: PLR0911 -- a case an operator
        match part.formula:
            case tree.Atom() as atom:
                match = self._matches(step)[self._places[atom]]
                wanted = [part.values.get(part.scope[name]) for _, name in atom.refs]
                return match is not None and list(match) == wanted
            case tree.Pre(operand):
                if step == 1:
                    return False
                return self.at(part.child(operand), step - 1) if step > self.first else None
            case tree.Once(operand, bound):
                return self._once(part, part.child(operand), bound, step)
            case tree.Historically(operand, bound):
                return _negated(self._once(part, part.child(operand), bound, step, negated=True))
            case tree.Since(left, right, bound):
                return self._since(part.child(left), part.child(right, 1), bound, step)
        found = self.bindings(part)
        if found is None:
            return None
        values = (self.at(body, step) for body in found)
        decided = isinstance(part.formula, tree.Exists)
        value = _any(values) if decided else _all(values)
        return value if value is decided or self.first == 1 else None

    def _once(self, part: Part, operand: Part, bound: Bound, step: int, *, negated: bool = False) -> Tri:
        node = self._network.places.get(part.path)
        if isinstance(node, Ever):
            since = node.when(key_of([part.values.get(v) for v in node.variables]))
            now = self.time(step) - bound.lower
            if since is None or since != now or not self._timed:
                return since is not None and since <= now
        window, complete = self.window(bound, step)
        values = (self.at(operand, j) for j in reversed(window))
        value = _any(map(_negated, values) if negated else values)
        return value if value is True or complete else None

    def _since(self, left: Part, right: Part, bound: Bound, step: int) -> Tri:
        window, complete = self.window(bound, step)
        certain, possible = True, False
        for j in range(step, window.start - 1, -1):
            held = self.at(right, j) if j in window else False
            if held is True and certain:
                return True
            possible = possible or held is not False
            ever_since = self.at(left, j)
            if ever_since is False:
                return None if possible else False
            certain = certain and ever_since is True
        return None if possible or not complete else False

    def _matches(self, step: int) -> Matches:
        if step not in self._seen:
            self._seen[step] = self._past.matches(step - self.first)
        return self._seen[step]

    def _variables(self, part: Part) -> tuple[int, ...]:
        """The variables that a part depends on."""
        if part.path not in self._free:
            self._free[part.path] = tuple(sorted(part.scope[name] for name in _free(part.formula)))
        return self._free[part.path]

    def _collect(self) -> dict[str, set[str]]:
        """The remembered values of the variables, by name."""
        texts: dict[str, set[str]] = {}
        refs = [(place, [name for _, name in atom.refs]) for atom, place in self._places.items() if atom.refs]
        for step in range(self.first, self.first + len(self._past.times)):
            matches = self._matches(step)
            for place, names in refs:
                for name, text in zip(names, matches[place] or (), strict=False):
                    texts.setdefault(name, set()).add(text)
        return texts


def _free(formula: Formula) -> frozenset[str]:
    if isinstance(formula, tree.Atom | tree.Relation):
        return frozenset(formula.variables)
    inner = frozenset[str]().union(*(_free(child) for child in tree.children(formula)))
    return inner - {formula.variable} if isinstance(formula, tree.Exists | tree.Forall) else inner


def _negated(value: Tri) -> Tri:
    return None if value is None else not value


def _any(values: Iterator[Tri]) -> Tri:
    known = True
    for value in values:
        if value:
            return True
        known = known and value is not None
    return False if known else None


def _all(values: Iterator[Tri]) -> Tri:
    return _negated(_any(_negated(value) for value in values))
