"""Why a formula holds or does not at the last step.

A conjunction that fails is explained by one side that does, one that holds by both; a temporal operator by the steps
that decide it, and its operand at these in turn, as far as they are remembered; and so on down to atoms. What is
explained at several steps at once is explained once.
"""

from __future__ import annotations

from collections.abc import Sequence

from msgspec import structs

from oracle_server.core.explanation import Failing, Reason, Why
from oracle_server.core.formula import tree
from oracle_server.core.formula.parse import Time
from oracle_server.core.formula.tree import Bound, Formula
from oracle_server.core.past import Past
from oracle_server.engines.native.build import Network
from oracle_server.engines.native.ever import Ever
from oracle_server.engines.native.guarded import SomeGuarded
from oracle_server.engines.native.keys import key_of, texts_of
from oracle_server.engines.native.latest import Latest
from oracle_server.engines.native.parts import Part, is_simple
from oracle_server.engines.native.reasons import leaves, size, spots
from oracle_server.engines.native.recall import Recall
from oracle_server.engines.native.saying import Saying
from oracle_server.engines.native.some import Some, SomeOf
from oracle_server.engines.native.window import Window
from oracle_server.engines.native.wording import Wording, scalar

Steps = Sequence[int]
"""Numbers of remembered steps, ascending."""
_MOST_STEPS = 2_000
A_PART = 50
"""What a part of the formula costs, in the effort that the past is looked through with."""
_MOST_TOLD = 3
"""Values that are shown where all decide together."""


def explain(formula: Formula, network: Network, time: Time, last: int, past: Past) -> Why:
    """Why the formula holds, or does not, at the last step, number `last`; `past` are the remembered steps."""
    recall = Recall(formula, network, time, last, past)
    try:
        return _explain(formula, network, time, recall)
    finally:
        if past.spent is not None:
            past.spent(recall.spent + A_PART * (len(network.atoms) + len(network.operators)))


def _explain(formula: Formula, network: Network, time: Time, recall: Recall) -> Why:
    part, last = Part(formula, (), {}, {}), recall.last
    explainer = Explainer(network, recall, Wording(time, network.timeline.now, recall))
    holds = explainer.holds(part)
    deciding = None
    if isinstance(formula, tree.Exists | tree.Forall) and holds is isinstance(formula, tree.Exists):
        deciding = explainer.deciding(part)
    if deciding is None:
        return Why(holds, {}, 0, tuple(explainer.reasons(part, holds, [last])))
    inner, others = deciding
    values = {name: scalar(inner.values[i]) for name, i in inner.scope.items() if i in inner.values}
    return Why(holds, values, others, tuple(explainer.reasons(inner, explainer.holds(inner), [last])))


class Explainer:
    """Finds the reasons of parts that look back."""

    def __init__(self, network: Network, recall: Recall, wording: Wording) -> None:
        self._network, self._recall, self._wording = network, recall, wording
        self._saying = Saying(recall, wording)
        self._now = recall.last

    def holds(self, part: Part) -> bool:
        """Whether a part holds now."""
        return self._recall.at(part, self._now) is True

    def reasons(self, part: Part, holds: bool, steps: Steps) -> list[Reason]:
        """What decides that a part holds at all of some steps, or at none of them."""
        if len(steps) > _MOST_STEPS or part.formula in (tree.FIRST, tree.FALSE):
            return [self._plain(part, steps, holds)]
        found = self._deciding_parts(part, steps, holds)
        if part.formula.written is None or isinstance(part.formula, tree.Atom):
            return found
        if isinstance(part.formula, tree.Not | tree.And | tree.Or | tree.Implies):
            return [self._named(part, steps, holds, found)]
        return [structs.replace(reason, told=True) for reason in found]

    def stood(self, part: Part, steps: Steps, *, holds: bool) -> Reason:
        """That a part held at all of some steps, or at none of them, without its reasons."""
        return self._plain(part, steps, holds)

    def _named(self, part: Part, steps: Steps, holds: bool, found: list[Reason]) -> Reason:
        """That a part with a name held, or did not, and why."""
        now = "holds" if holds else "does not hold"
        text = now if [*steps] == [self._now] else "held" if holds else "did not hold"
        return self._reason(part, steps, holds, text, parts=tuple(found), told=True)

    def _deciding_parts(self, part: Part, steps: Steps, holds: bool) -> list[Reason]:  # noqa: PLR0911 -- a case a node
        match part.formula:
            case tree.Not(operand):
                return self.reasons(part.child(operand), not holds, steps)
            case tree.And(left, right):
                sides = [(part.child(left), holds), (part.child(right, 1), holds)]
                return self._all(sides, steps) if holds else self._one(part, holds, sides, steps)
            case tree.Or(left, right):
                sides = [(part.child(left), holds), (part.child(right, 1), holds)]
                return self._one(part, holds, sides, steps) if holds else self._all(sides, steps)
            case tree.Implies(left, right):
                sides = [(part.child(left), not holds), (part.child(right, 1), holds)]
                return self._one(part, holds, sides, steps) if holds else self._all(sides, steps)
            case tree.Exists() | tree.Forall():
                return self._quantifier(part, steps, holds)
            case tree.Atom():
                return [self._plain(part, steps, holds)]
            case tree.Pre(operand):
                return [self._pre(part, part.child(operand), steps, holds)]
            case tree.Since():
                return [self._since(part, steps, holds)]
            case tree.Once() | tree.Historically():
                return [self._once(part, steps, holds)]
            case _:
                raise AssertionError(part.formula)  # what waits for what comes is explained by its obligations

    def deciding(self, part: Part) -> tuple[Part, int] | None:
        """A quantifier's body with values that decide it now, and how many others do; None where all do together."""
        node = self._network.places.get(part.path)
        if not isinstance(node, Some | SomeOf | SomeGuarded):
            return None
        own = key_of([part.values.get(v) for v in node.variables])
        keys = node.keys(own)
        if not keys:
            return None
        first = min(keys, key=lambda key: [(text is None, text or "") for text in texts_of(key)])
        found = dict(zip(node.body_variables, texts_of(first), strict=True))
        return part.body(self._network).given(found), len(keys) - 1

    def _all(self, sides: list[tuple[Part, bool]], steps: Steps) -> list[Reason]:
        return [reason for side, holds in sides for reason in self.reasons(side, holds, steps)]

    def _one(self, part: Part, holds: bool, sides: list[tuple[Part, bool]], steps: Steps) -> list[Reason]:
        """The reasons of one side, the shorter ones; of both, where each decides at some of the steps."""
        found = [[s for s in steps if self._recall.at(side, s) is value] for side, value in sides]
        alone = [self.reasons(*side, steps) for side, held in zip(sides, found, strict=True) if len(held) == len(steps)]
        if alone:
            return min(alone, key=size)
        rest = sorted({*steps}.difference(found[0]))
        if not {*rest}.issubset(found[1]):
            return [self._plain(part, steps, holds)]
        return [*self.reasons(*sides[0], found[0]), *self.reasons(*sides[1], rest)]

    def _quantifier(self, part: Part, steps: Steps, holds: bool) -> list[Reason]:
        if holds is not isinstance(part.formula, tree.Exists):
            return [self._for_all(part, steps, holds)]
        if [*steps] == [self._now]:
            deciding = self.deciding(part)
            groups = None if deciding is None else [(*deciding, steps)]
        else:
            groups = self._groups(part, steps, holds)
        if groups is None:
            return [self._plain(part, steps, holds)]
        reasons = []
        for body, others, group in groups:
            given = f"for {self._wording.values(body.scope, body.values)}" + (f" (and {others} more)" if others else "")
            parts = tuple(self.reasons(body, holds, group))
            reasons.append(self._reason(part, group, holds, given, parts=parts))
        return reasons

    def _groups(self, part: Part, steps: Steps, holds: bool) -> list[tuple[Part, int, Steps]] | None:
        """A quantifier's body with values that decide it, and the steps where they do; None where that is not known."""
        groups: list[tuple[Part, int, Steps]] = []
        bodies, rest = self._recall.bindings(part) or [], [*steps]
        while rest:
            body = next((b for b in bodies if self._recall.at(b, rest[0]) is holds), None)
            if body is None:
                return None
            groups.append((body, 0, [s for s in rest if self._recall.at(body, s) is holds]))
            rest = sorted({*rest}.difference(groups[-1][2]))
        return groups

    def _for_all(self, part: Part, steps: Steps, holds: bool) -> Reason:
        """All values decide together: a few are shown, and the window that all of them need."""
        text = "for every value" if holds else "for no value"
        bodies = self._recall.bindings(part) if self._recall.first == 1 else None
        if not bodies or any(self._recall.at(body, s) is not holds for body in bodies for s in steps):
            return self._reason(part, steps, holds, text)
        found = [(body, self.reasons(body, holds, steps)) for body in bodies]
        told = [spot for _, reasons in found for spot in spots(reasons)]
        window = (min(spot[0] for spot in told), max(spot[1] for spot in told)) if told else None
        telling = [item for item in found if any(reason.holds for reason in leaves(item[1]))][:_MOST_TOLD]
        parts = []
        for body, reasons in telling:
            given = f"for {self._wording.values(body.scope, body.values)}"
            parts.append(self._reason(body, steps, holds, given, parts=tuple(reasons)))
        return self._reason(part, steps, holds, text, window=window, parts=tuple(parts))

    def _pre(self, part: Part, operand: Part, steps: Steps, holds: bool) -> Reason:
        before = [s - 1 for s in steps if s > 1]
        if not before:
            return self._reason(part, steps, holds, "there is no step before")
        known = before[0] >= self._recall.first
        if not known and [*steps] != [self._now]:
            return self._plain(part, steps, holds)
        times = self._times(before) if known else [self._network.timeline.before]
        parts = self._deeper([(operand, holds, before)]) if known else ()
        found = before if known else []
        held, failed = self._saying.held(operand, times, found, holds=holds)
        text = f"its operand {held}"
        return self._reason(part, steps, holds, text, times, found, parts=parts, failed=failed, told=True)

    def _once(self, part: Part, steps: Steps, holds: bool) -> Reason:
        formula = part.formula
        assert isinstance(formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        operand, wanted = part.child(formula.operand), isinstance(formula, tree.Once)
        if holds is not wanted:
            return self._nowhere(part, operand, steps, holds)
        times, found = self._witnesses(part, operand, steps, wanted=wanted)
        if not times:
            return self._plain(part, steps, holds)
        parts = self._deeper([(operand, wanted, found)])
        text, failed = self._saying.stood(operand, times, found, holds=wanted)
        text += self._saying.ran_out(formula.bound) if [*steps] == [self._now] else ""
        return self._reason(part, steps, holds, text, times, found, parts=parts, failed=failed)

    def _witnesses(self, part: Part, operand: Part, steps: Steps, *, wanted: bool) -> tuple[list[int], list[int]]:
        """The times of steps that make `once` hold at all of some steps, and these as far as they are remembered."""
        assert isinstance(part.formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        if [*steps] == [self._now]:
            return self._witness_now(part, operand, wanted=wanted)
        found: list[int] = []
        for step in steps:
            window, _ = self._recall.window(part.formula.bound, step)
            if found and found[-1] in window:
                continue
            witness = next((j for j in reversed(window) if self._recall.at(operand, j) is wanted), None)
            if witness is None:
                return [], []
            found.append(witness)
        return self._times(found), found

    def _witness_now(self, part: Part, operand: Part, *, wanted: bool) -> tuple[list[int], list[int]]:
        """The time of the step that the engine goes by at present, and the step if it is remembered.

        Values that the engine does not tell apart any more share a time, which may be that of one of them only: then
        it is another step.
        """
        when = self._when(part)
        if when is None:
            return [], []
        found = self._recall.steps(when)
        stood = [self._recall.at(operand, step) for step in found]
        if wanted in stood:
            step = found[stood.index(wanted)]
            return [when], [step]
        if not stood or None in stood:
            return [when], []
        window, _ = self._recall.window(_bound(part), self._now)
        other = next((j for j in reversed(window) if self._recall.at(operand, j) is wanted), None)
        return ([], []) if other is None else ([self._recall.time(other)], [other])

    def _when(self, part: Part) -> int | None:
        """The time of a step that makes an operator hold now, as the engine knows it."""
        node = self._network.places[part.path]
        assert isinstance(node, Ever | Latest | Window)  # noqa: S101 -- what these operators are built as
        return node.when(key_of([part.values.get(v) for v in node.variables]))

    def _nowhere(self, part: Part, operand: Part, steps: Steps, holds: bool) -> Reason:
        assert isinstance(part.formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
        window, complete = self._windows(part.formula.bound, steps)
        where, ends = self._where(part.formula.bound, steps, window)
        words = "at every one" if holds else "none"
        parts: tuple[Reason, ...] = ()
        simple = is_simple(operand.formula)
        if not simple and complete and window and self._recall.are(operand, holds, window):
            parts = self._deeper([(operand, holds, window)])
        text = f"{words} {where}"
        if not holds and [*steps] == [self._now]:
            text += self._saying.nearest(operand, part.formula.bound, window)
        return self._reason(part, steps, holds, text, window=ends, parts=parts)

    def _since(self, part: Part, steps: Steps, holds: bool) -> Reason:
        formula = part.formula
        assert isinstance(formula, tree.Since)  # noqa: S101 -- see `reasons`
        left, right = part.child(formula.left), part.child(formula.right, 1)
        return self._since_held(part, left, right, steps) if holds else self._since_not(part, left, right, steps)

    def _since_held(self, part: Part, left: Part, right: Part, steps: Steps) -> Reason:
        assert isinstance(part.formula, tree.Since)  # noqa: S101 -- see `reasons`
        witnesses, between, before = set[int](), set[int](), 0
        for step in steps:
            witness = self._recall.since(left, right, part.formula.bound, step)
            if witness is None:
                break
            witnesses.add(witness)
            between.update(range(max(witness, before) + 1, step + 1))  # a later step has no earlier witness
            before = step
        else:
            found = sorted(witnesses)
            times = self._times(found)
            lasted = tree.lasted(part.formula) is not None
            sides: list[tuple[Part, bool, Steps]] = [(right, True, found), (left, True, sorted(between))]
            parts = self._deeper([(right, True, sorted(witnesses | between))] if lasted else sides)
            text = self._saying.since(left, right, times, found)
            text += self._saying.ran_out(part.formula.bound) if [*steps] == [self._now] else ""
            window = (times[0], self._recall.time(steps[-1])) if between else None
            return self._reason(part, steps, True, text, times, found, window=window, parts=parts, told=lasted)
        when = self._when(part) if [*steps] == [self._now] else None
        if when is None:
            return self._plain(part, steps, True)
        text = self._saying.since(left, right, [when], ()) + self._saying.ran_out(part.formula.bound)
        return self._reason(part, steps, True, text, [when], window=(when, self._network.timeline.now))

    def _since_not(self, part: Part, left: Part, right: Part, steps: Steps) -> Reason:
        assert isinstance(part.formula, tree.Since)  # noqa: S101 -- see `reasons`
        window, whole = self._windows(part.formula.bound, steps)
        where, ends = self._where(part.formula.bound, steps, window)
        if whole and [*steps] == [self._now] and is_simple(right.formula) and self._recall.are(right, False, window):
            text = f"no {self._wording.name(right)} {where}"
            text += self._saying.nearest(right, part.formula.bound, window)
            return self._reason(part, steps, False, text, window=ends)
        known, missing = True, set[int]()
        broken = set[int]()
        for step in steps:
            candidates, complete = self._recall.window(part.formula.bound, step)
            if self._recall.are(right, False, candidates):
                missing.update(candidates)
                known = known and complete
                continue
            past = range(step, candidates.start - 1, -1)
            failed = next((j for j in past if self._recall.at(left, j) is False), None)
            known = known and failed is not None
            broken.update(() if failed is None else (failed,))
            missing.update(j for j in candidates if failed is None or j >= failed)
        known = known and self._recall.are(right, False, missing)
        plain = is_simple(right.formula) and not broken
        sides = [(right, False, sorted(missing)), (left, False, sorted(broken))] if known and not plain else []
        text = f"none with its left side ever since {where}"
        lasted = tree.lasted(part.formula) is not None
        if lasted:
            sides = [(right, False, sorted(missing | broken))] if sides else []
            text = "it has not lasted so long"
        parts = tuple(r for side, value, at in sides if at for r in self.reasons(side, value, at))
        return self._reason(part, steps, False, text, window=ends, parts=parts, told=lasted)

    def _windows(self, bound: Bound, steps: Steps) -> tuple[list[int], bool]:
        """All steps in the windows of some steps, and whether all of them are remembered."""
        windows = [self._recall.window(bound, step) for step in steps]
        return sorted({j for window, _ in windows for j in window}), all(complete for _, complete in windows)

    def _where(self, bound: Bound, steps: Steps, window: Steps) -> tuple[str, tuple[int, int] | None]:
        """Windows in words, and the first and the last time in them."""
        if [*steps] == [self._now]:
            first, last = self._wording.ends(bound)
            return self._wording.window(bound), (first, last) if first <= last else None
        if not window:
            return "before there were steps", None
        ends = self._recall.time(window[0]), self._recall.time(window[-1])
        return self._wording.during(*ends), ends

    def _deeper(self, sides: list[tuple[Part, bool, Steps]]) -> tuple[Reason, ...]:
        """The reasons for operands, where they are more than whether an atom held."""
        if all(is_simple(operand.formula) for operand, _, _ in sides):
            return ()
        return tuple(reason for side in sides if side[2] for reason in self.reasons(*side))

    def _times(self, steps: Steps) -> list[int]:
        return [self._recall.time(step) for step in steps]

    def _plain(self, part: Part, steps: Steps, holds: bool) -> Reason:
        """The reason that a part held, or did not, without parts of its own."""
        times = self._times(steps)
        now = [*steps] == [self._now]
        text, failed = self._saying.stood(part, times, steps, holds=holds)
        return self._reason(part, [self._now], holds, text, [] if now and not holds else times, steps, failed=failed)

    def _reason(
        self,
        part: Part,
        steps: Steps,
        holds: bool,
        text: str,
        times: Sequence[int] = (),
        found: Steps = (),
        *,
        window: tuple[int, int] | None = None,
        parts: tuple[Reason, ...] = (),
        failed: tuple[Failing, ...] = (),
        told: bool = False,
    ) -> Reason:
        """A reason at `steps`, which steps `found` at `times` decide, or a window."""
        if [*steps] != [self._now]:
            text = f"({self._wording.at(self._times(steps), steps)}) {text}"
        if len(times) > 1:
            window = times[0], times[-1] if window is None else window[1]
        at = times[0] if len(times) == 1 else None
        step = found[0] if at is not None and found else None
        unnumbered = at is not None and self._wording.is_unnumbered(at)
        window = None if window is None else self._wording.numbered(*window)
        return Reason(self._wording.formula(part), holds, text, at, window, parts, step, failed, unnumbered, told)


def _bound(part: Part) -> Bound:
    assert isinstance(part.formula, tree.Once | tree.Historically)  # noqa: S101 -- see `reasons`
    return part.formula.bound
